"""How often does an ant that wanders turn over [D22]? python experiments/ant_wandering.py.

Ants begin standing and push at random for 6 s, anew every so many steps: with any force, or as hard
as they can one way or the other. Writes how often they turn over, and what share of the time they
are tilted by more than 45 degrees, to `results/ant-notes/wandering-at-random.json`.
"""

import json

import numpy as np
from ant_inside import RESULTS

from everystate.envs import make
from everystate.skills.ant import STANDS, state

ANTS, STEPS, SECOND = 500, 120, 20


def upright(states: np.ndarray) -> np.ndarray:
    """1 upright, -1 upside down."""
    return states[:, 1] * states[:, 5] - states[:, 2] * states[:, 4]


def wander(hard: bool, kept: int) -> dict[str, float]:
    """Turns per ant and minute, and the share of steps tilted."""
    env, rng = make("ant", ANTS, 0), np.random.default_rng(0)
    env.set_observations(np.tile(np.array(state(STANDS)), (ANTS, 1)))
    side, turns, tilted, actions = np.ones(ANTS), 0, 0, np.zeros((ANTS, 8))
    for step in range(STEPS):
        if step % kept == 0:
            actions = rng.uniform(-1, 1, (ANTS, 8))
            actions = np.sign(actions) if hard else actions
        up = upright(env.step(actions)[0])
        there = np.where(up > 0.7, 1, np.where(up < -0.7, -1, side))
        turns, side = turns + int((there != side).sum()), there
        tilted += int((np.abs(up) < 0.7).sum())
    minutes = ANTS * STEPS / SECOND / 60
    return {"turns_per_minute": round(turns / minutes, 2), "tilted": tilted / (ANTS * STEPS)}


def main() -> None:
    """Both ways, for a range of steps."""
    found = {
        way: {str(kept): wander(hard, kept) for kept in (1, 2, 4, 6, 8, 12)}
        for way, hard in (("any force", False), ("full force", True))
    }
    print(json.dumps(found, indent=1))
    said = {"command": "python experiments/ant_wandering.py", "kept_for_steps": found}
    (RESULTS / "wandering-at-random.json").write_text(json.dumps(said, indent=1) + "\n")


if __name__ == "__main__":
    main()
