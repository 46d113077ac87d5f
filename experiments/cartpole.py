"""Trains and evaluates several seeds on the cartpole, and what it is without each of its settings.

    python experiments/cartpole.py

`seeds.py` says where everything goes. The figures are `success.png` and `skills.png`. Settings
other than `quick` have one seed and one thing changed: the first from `quick`, others from `short`.
"""

from pathlib import Path

import seeds

from everystate.viewing.figures import comparison, skill_rates


def short(change: str = "") -> seeds.Setting:
    """One thing changed, for 80 epochs, as skills come early; a fifth of the suite's goals."""
    return seeds.Setting(f"--epochs 80 {change}", seeds=3, evaluation="--episodes 40")


SETTINGS = {
    "quick": seeds.Setting("", seeds=5),
    "short": short(),
    "undiscounted": short("--discount 1"),  # D18
    "always-absorbed": short("--absorb 1"),  # D10
    "no-approaches": short("--approach-share 0"),  # D19
    "absolute-goals": short("--no-relative-goals"),  # D20
    "wide-weights": short("--weight-clip 8"),  # D1
    "latent-reward": short("--reward-space latent"),  # D9
    "imagined-goals": short("--goals imagined --m 20"),  # D17
    "rarest-goals": short("--m 20"),  # D17
    "no-hindsight": short("--no-hindsight"),
}


def draw(folders: dict[str, list[Path]]) -> None:
    """Success over training, and the skills at its end."""
    results = seeds.results_of("cartpole")
    comparison({"quick": folders["quick"]}).savefig(results / "success.png", dpi=150)
    skill_rates(folders).savefig(results / "skills.png", dpi=150)


if __name__ == "__main__":
    description = str(__doc__).splitlines()[0]
    seeds.main("cartpole", SETTINGS, draw, description=description, skills=True)
