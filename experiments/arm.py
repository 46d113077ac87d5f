"""The arm of the tutorial, for which no setting was chosen: which goals let it learn to stand up?

    python experiments/arm.py

`seeds.py` says where everything goes; the figure is `success.png`, the table `settings.md`. What
is measured is whether it swings up from hanging and holds (`arm_goals.json`): by chance it hardly
moves.
"""

from pathlib import Path
from typing import Any

import seeds

from everystate.scaling import Evaluation
from everystate.viewing.figures import comparison

BODY = "experiments/arm.xml"


def setting(**change: Any) -> seeds.Setting:
    """Preset `quick`, shorter, with one thing changed."""
    goals = Evaluation(goals_file="experiments/arm_goals.json")
    return seeds.Setting({"epochs": 40, **change}, 3, goals)


SETTINGS = {
    "quick": setting(),
    "any-visited-goals": setting(m=1),
    "imagined-goals": setting(goals="imagined"),
    # What `quick` has on the ramp instead, and on the cartpole besides.
    "as-the-ramp": setting(
        goals="imagined",
        weight_clip=8.0,
        reward_space="latent",
        discount=1.0,
        absorb=1.0,
        goal_value_weight=1.0,
        relative_goals=False,
        approach_share=0.0,
        p_curric=0.2,
        j=1,
        N=8,
    ),
    "as-the-cartpole": setting(
        hindsight=False,
        absorb=0.1,
        relative_errors=True,
        centre_weight=100.0,
        imagined_weight=50.0,
        imagined_steps=8,
        imagined_absorb=False,
        imagined_targets=0.5,
        pursued_share=0.5,
        central_share=0.5,
        not_finite="roll-back",
    ),
}


COLUMNS: dict[str, seeds.Column] = {
    "policy": lambda e: e["success"]["all"]["0.5"]["last"],
    "planning": lambda e: e["success_plan"]["all"]["0.5"]["last"],
}


def draw(folders: dict[str, list[Path]]) -> None:
    """Training goals reached, and how often it stands up at the end."""
    seeds.write_table(BODY, folders, COLUMNS)
    comparison(folders, over="epoch").savefig(seeds.results_of(BODY) / "success.png", dpi=150)


if __name__ == "__main__":
    seeds.main(BODY, SETTINGS, draw, description=str(__doc__).splitlines()[0])
