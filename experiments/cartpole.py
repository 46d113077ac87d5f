"""Trains and evaluates several seeds on the cartpole, and what it is without each of its settings.

    python experiments/cartpole.py

`seeds.py` says where everything goes. The figures are `success.png` and `skills.png`. Settings
other than `quick` have one seed and one thing changed: the first from `quick`, others from `short`.
"""

from pathlib import Path

import seeds

from everystate.viewing.figures import comparison, skill_rates

_SHORT = "--epochs 80"
SETTINGS: dict[str, tuple[str, int]] = {
    "quick": ("", 5),
    "short": (_SHORT, 3),
    "undiscounted": (f"{_SHORT} --discount 1", 3),  # D18
    "no-approaches": (f"{_SHORT} --approach-share 0", 3),  # D19
    "imagined-goals": (f"{_SHORT} --goals imagined --m 20", 3),  # D17
    "always-absorbed": (f"{_SHORT} --absorb 1", 3),  # D10
    "never-absorbed": (f"{_SHORT} --absorb 0", 3),
    "absolute-goals": (f"{_SHORT} --no-relative-goals", 3),  # D20
    "latent-reward": (f"{_SHORT} --reward-space latent", 3),  # D9
    "wide-weights": (f"{_SHORT} --weight-clip 8", 3),  # D1
    "few-candidates": (f"{_SHORT} --j 1 --N 8", 3),
    "no-hindsight": (f"{_SHORT} --no-hindsight", 3),
}


def draw(folders: dict[str, list[Path]]) -> None:
    """Success over training, and the skills at its end."""
    results = seeds.results_of("cartpole")
    comparison({"quick": folders["quick"]}).savefig(results / "success.png", dpi=150)
    skill_rates(folders).savefig(results / "skills.png", dpi=150)


if __name__ == "__main__":
    description = str(__doc__).splitlines()[0]
    seeds.main("cartpole", SETTINGS, draw, description=description, skills=True)
