"""Figure 1 of the paper, with the balancing that its cartpole could not do.

    python tools/figure1.py

Films and filmstrips of the shipped cartpole agent, by its policy alone, as
results/figure-1/SKILL.mp4 and .png.
"""

from pathlib import Path

import everystate
from everystate.viewing import recording, video

FOLDER = Path(__file__).resolve().parent.parent / "results" / "figure-1"
SKILLS = ("spin-left", "spin-right", "balance")


def main() -> None:
    """Records each skill once and draws it twice; what is there already is made anew."""
    agent = everystate.load("cartpole")
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in SKILLS:
        recorded = recording.record_skill(agent, name, plan=False, seed=0)
        for suffix in (".mp4", ".png"):
            path = FOLDER / f"{name}{suffix}"
            path.unlink(missing_ok=True)
            video.write(recorded, recording.body_of(agent), path)
        print(recorded.title)


if __name__ == "__main__":
    main()
