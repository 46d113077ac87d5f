"""Trains and evaluates several seeds on the cartpole, and what it is without each of its settings.

    python experiments/cartpole.py

`seeds.py` says where everything goes. The figures are `success.png` and `skills.png`, the table
`settings.md`. `short` is `quick` for fewer epochs; the others have one thing changed from it, but
for the last two: pursued goals over a whole run, and short with imagined steps besides.
"""

from pathlib import Path
from statistics import mean
from typing import Any

import seeds

from everystate.scaling import Evaluation
from everystate.viewing.figures import comparison, skill_rates

_WAYS = ("left", "right")
_PLACES = ("left", "middle", "right")


def short(**change: Any) -> seeds.Setting:
    """One thing changed, for 80 epochs, as skills come early; a fifth of the suite's goals."""
    return seeds.Setting({"epochs": 80, **change}, 3, Evaluation(episodes=40, skills=True))


PURSUED = {"pursued_share": 0.5, "central_share": 0.5}  # D24
SETTINGS = {
    "quick": seeds.Setting({}, 5, Evaluation(skills=True)),
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
    "whole-pursued-goals": seeds.Setting(PURSUED, 5, Evaluation(skills=True)),
    "imagined-steps": short(
        **PURSUED, imagined_weight=10.0, imagined_steps=8, not_finite="roll-back"
    ),  # D25
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
    "policy: upright goals held": lambda e: e["success"]["upright"]["0.5"]["last"],
    "policy: all goals held": lambda e: e["success"]["all"]["0.5"]["last"],
}


def draw(folders: dict[str, list[Path]]) -> None:
    """Success over training, and the skills at its end."""
    results = seeds.results_of("cartpole")
    comparison({"quick": folders["quick"]}).savefig(results / "success.png", dpi=150)
    skill_rates(folders).savefig(results / "skills.png", dpi=150)
    seeds.write_table("cartpole", folders, COLUMNS)


if __name__ == "__main__":
    description = str(__doc__).splitlines()[0]
    seeds.main("cartpole", SETTINGS, draw, description=description)
