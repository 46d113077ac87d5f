"""Trains and evaluates the ant: `python experiments/ant.py`.

`seeds.py` says where everything goes. The figure is `skills.png`, the table
`settings.md`: starts from which each skill succeeded, and goals within 1 sigma at any step.
"""

from pathlib import Path

import seeds

from everystate.scaling import Evaluation
from everystate.skills import SKILLS
from everystate.viewing.figures import skill_rates

# The search takes 27 ms an action: 50 of the suite's goals, and 100 starts of every skill.
_EVALUATION = Evaluation(episodes=50, skills=True)
SETTINGS = {
    "quick": seeds.Setting({"evaluation_period": 10}, 3, _EVALUATION),  # as in the comparison
}


def column(name: str, by: str = "skills_plan") -> seeds.Column:
    """A skill with planning, or by the policy."""
    return lambda e: e[by][name]


COLUMNS: dict[str, seeds.Column] = {name: column(name) for name in SKILLS["ant"]}
COLUMNS |= {f"{name} by the policy": column(name, "skills") for name in SKILLS["ant"]}
COLUMNS["goals by the policy"] = lambda e: e["success"]["all"]["1"]["any"]
COLUMNS["goals with planning"] = lambda e: e["success_plan"]["all"]["1"]["any"]


def draw(folders: dict[str, list[Path]]) -> None:
    """The skills at the end of training."""
    skill_rates(folders).savefig(seeds.results_of("ant") / "skills.png", dpi=150)
    seeds.write_table("ant", folders, COLUMNS)


if __name__ == "__main__":
    description = str(__doc__).splitlines()[0]
    seeds.main("ant", SETTINGS, draw, description=description)
