"""Figure 2 of the paper: six skills of the ant.

    python tools/figure2.py [RUN]

Films and filmstrips of the shipped agent, or of a run's, by the policy alone, each from the first
of ten starts from which the skill succeeds, or else from the first of all, which its title says; of
recovery from that in which it was the most upside down: results/figure-2/SKILL.mp4, .png.
"""

import sys
from pathlib import Path

import everystate
from everystate import Agent
from everystate.skills.ant_rules import up
from everystate.viewing import recording, video
from everystate.viewing.recording import Recording

FOLDER = Path(__file__).resolve().parent.parent / "results" / "figure-2"
SKILLS = ("recover", "flip", "spin-right", "walk-sideways-by-gait", "jump", "feet-up")


def shown(agent: Agent, name: str) -> Recording:
    """A success, if there is one."""
    tries = [recording.record_skill(agent, name, plan=False, seed=seed) for seed in range(10)]
    done = [one for one in tries if one.title.endswith(": done")] or tries
    return min(done, key=lambda one: up(one.states).min()) if name == "recover" else done[0]


def main(run: str) -> None:
    """Records each skill once and draws it twice; what is there already is made anew."""
    agent = everystate.load(run)
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in SKILLS:
        recorded = shown(agent, name)
        for suffix in (".mp4", ".png"):
            path = FOLDER / f"{name}{suffix}"
            path.unlink(missing_ok=True)
            video.write(recorded, recording.body_of(agent), path)
        print(recorded.title, flush=True)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "ant")
