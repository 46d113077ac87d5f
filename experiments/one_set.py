"""How far one set of numbers carries: python experiments/one_set.py [--out RUNS].

Makes the runs of `one-set.toml` in runs/one-set, in 8 to 70 minutes each on one core. Of every run
that is over it writes results/one-set/NAME-SEED.json: suites, beside random actions and doing
nothing, and skills where the body has them; of arm and pendulum also whether it stands up and stays
so. What is there already is left.
"""

from pathlib import Path
from typing import Any

import numpy as np
import seeds
from jaxtyping import Bool, Float

import everystate
from everystate import envs
from everystate.agent.json_files import read_json
from everystate.evaluation import raw, references
from everystate.studies import Study
from everystate.studies.runs import MEASURED, finished

RESULTS = seeds.RESULTS / "one-set"
UPRIGHT = {"arm": (-1.0, 0.0, 0.0), "pendulum": (1.0, 0.0, 0.0)}
"""Cosine, sine and velocity of a body that hangs down in the end if nothing is done."""
STARTS, PLAY, STEPS, LAST = 100, 100, 200, 25
"""Starts, each after steps of random actions; steps to get up in; the last steps, all upright."""
ANGLE, SPEED = 0.2, 0.5
"""Most that it may be off, in rad and rad/s."""
_KEPT = ("epoch", "steps", "episode/reached", "units/", "eval/rest/score", "eval/motion/score")


def stands(act: Any, body: str, goal: tuple[float, ...]) -> Bool[np.ndarray, " starts"]:
    """Whether it is upright, and all but still, in each of the last steps."""
    env = envs.make(body, STARTS, 0)
    observations, _ = env.reset(seed=0)
    rng, size = np.random.default_rng(0), env.single_action_space.shape[0]
    for _ in range(PLAY):
        observations, *_ = env.step(rng.uniform(-1, 1, (STARTS, size)).astype(np.float32))
    goals, upright = np.tile(np.array(goal, np.float32), (STARTS, 1)), []
    for _ in range(STEPS):
        observations, *_ = env.step(act(observations, goals))
        upright.append(_close(observations, goals))
    env.close()
    return np.logical_and.reduce(upright[-LAST:])


def _close(
    states: Float[np.ndarray, "starts 3"], goals: Float[np.ndarray, "starts 3"]
) -> Bool[np.ndarray, " starts"]:
    apart = np.arctan2(states[:, 1], states[:, 0]) - np.arctan2(goals[:, 1], goals[:, 0])
    off = np.abs(np.angle(np.exp(1j * apart)))
    still = np.abs(states[:, 2] - goals[:, 2]) < SPEED
    return np.logical_and.reduce([off < ANGLE, still])


def standing(run: Path, goal: tuple[float, ...]) -> dict[str, float]:
    """Shares of starts: by the policy, by random actions, and doing nothing."""
    agent, rng = everystate.load(run), np.random.default_rng(1)
    body = agent.config.body
    drawn = seeds.ROOT / body if body.endswith(".xml") else body

    def at_random(observations: Any, _: Any) -> Any:
        return rng.uniform(-1, 1, (len(observations), agent.body.action_size)).astype(np.float32)

    def nothing(observations: Any, _: Any) -> Any:
        return np.zeros((len(observations), agent.body.action_size), np.float32)

    actors = {"policy": agent.act, "random": at_random, "nothing": nothing}
    return {name: float(stands(act, str(drawn), goal).mean()) for name, act in actors.items()}


def measured(folder: Path) -> dict[str, Any]:
    """All that is said of a run."""
    lines, config = seeds.lines_of(folder), read_json(folder / "config.json")
    name, found = folder.parent.name, read_json(folder / MEASURED)
    for suite, readings in references(found, everystate.load(folder / "run").config).items():
        found["suites"][suite]["references"] = readings
    if name in UPRIGHT:
        found["stands"] = standing(folder / "run", UPRIGHT[name])
    minutes = round(lines[-1]["time/elapsed_s"] / 60, 1)
    return {
        **found,
        "trained": {"condition": name, **config},
        "minutes": minutes,
        "curves": seeds.curves(lines, _KEPT),
    }


def keep(study: Study, out: Path) -> None:
    """Writes what is missing of the runs that are over."""
    for name, one in study.conditions.items():
        for seed in one.seeds:
            folder, path = out / name / f"seed{seed}", RESULTS / f"{name}-{seed}.json"
            if finished(folder) and not path.exists():
                raw.write(path, measured(folder))
                print(path)


if __name__ == "__main__":
    seeds.main("one-set", keep, description=str(__doc__), out=seeds.ROOT / "runs" / "one-set")
