"""Trains and evaluates several seeds on the cartpole, and what it is without each of its settings.

    python experiments/cartpole.py

`seeds.py` says where everything goes. The figures are `success.png` and `skills.png`, the table
`settings.md`. `one-step` is what `quick` was before its policy imagined steps, for 200 epochs, and
`short` the same for 80; the others have one thing changed from that, but for the last: pursued
goals over a whole run.
"""

from pathlib import Path
from statistics import mean
from typing import Any

import seeds

from everystate.scaling import Evaluation
from everystate.viewing.figures import comparison, skill_rates

_WAYS = ("left", "right")
_PLACES = ("left", "middle", "right")


ONE_STEP: dict[str, Any] = {
    "pursued_share": 0.0,  # D24
    "central_share": 0.0,
    "imagined_weight": 0.0,  # D25
    "imagined_targets": 0.0,  # D26
    "centre_weight": 0.0,  # D28
    "relative_errors": False,  # D29
    "hindsight": True,  # D30
    "absorb": 0.5,  # D10
    "not_finite": "stop",
}
PURSUED = {"pursued_share": 0.5, "central_share": 0.5}


def whole(num_seeds: int, **change: Any) -> seeds.Setting:
    """All epochs, all goals of the suite."""
    return seeds.Setting(change, num_seeds, Evaluation(skills=True))


def short(**change: Any) -> seeds.Setting:
    """One thing changed, for 80 epochs, as skills come early; a fifth of the suite's goals."""
    options = {"epochs": 80, **ONE_STEP, **change}
    return seeds.Setting(options, 3, Evaluation(episodes=40, skills=True))


SETTINGS = {
    "quick": whole(5),
    "one-step": whole(5, epochs=200, **ONE_STEP),
    "short": short(),
    "undiscounted": short(discount=1.0),  # D18
    "always-absorbed": short(absorb=1.0),  # D10
    "no-approaches": short(approach_share=0.0),  # D19
    "absolute-goals": short(relative_goals=False),  # D20
    "wide-weights": short(weight_clip=8.0),  # D1
    "latent-reward": short(reward_space="latent"),  # D9
    "imagined-goals": short(goals="imagined", m=20),  # D17
    "rarest-goals": short(m=20),  # D17
    "no-hindsight": short(hindsight=False),
    "pursued-goals": short(**PURSUED),
    "whole-pursued-goals": whole(3, epochs=200, **{**ONE_STEP, **PURSUED}),
}


COLUMNS: dict[str, seeds.Column] = {
    "balance": lambda e: e["skills_plan"]["balance"],
    "spin, either way": lambda e: mean(e["skills_plan"][f"spin-{way}"] for way in _WAYS),
    "hang at three places": lambda e: mean(e["skills_plan"][f"hang-{at}"] for at in _PLACES),
    "pass the top": lambda e: e["skills_plan"]["pass-top"],
    "hanging goals held": lambda e: e["success_plan"]["hanging"]["0.5"]["last"],
    "upright goals held": lambda e: e["success_plan"]["upright"]["0.5"]["last"],
    "moving goals passed": lambda e: e["success_plan"]["moving"]["0.5"]["any"],
    "policy: hanging goals held": lambda e: e["success"]["hanging"]["0.5"]["last"],
    "policy: balance": lambda e: e["skills"]["balance"],
    "policy: upright goals held": lambda e: e["success"]["upright"]["0.5"]["last"],
    "policy: all goals held": lambda e: e["success"]["all"]["0.5"]["last"],
}


def draw(folders: dict[str, list[Path]]) -> None:
    """Success over training, and the skills at its end."""
    results = seeds.results_of("cartpole")
    both = {name: folders[name] for name in ("quick", "one-step")}
    comparison(both).savefig(results / "success.png", dpi=150)
    skill_rates(folders).savefig(results / "skills.png", dpi=150)
    seeds.write_table("cartpole", folders, COLUMNS)


if __name__ == "__main__":
    description = str(__doc__).splitlines()[0]
    seeds.main("cartpole", SETTINGS, draw, description=description)
