"""The arm of the tutorial, a body that no setting was chosen for, by preset `quick` and the ramp's.

    python experiments/arm.py

`seeds.py` says where everything goes; the figure is `success.png`.
"""

from pathlib import Path

import seeds

from everystate.viewing.figures import comparison

BODY = "experiments/arm.xml"
_EPOCHS = "--epochs 40"
# What `quick` has on the ramp instead.
_RAMP = (
    "--goals imagined --m 20 --weight-clip 8 --reward-space latent --discount 1 --absorb 1"
    " --goal-value-weight 1 --no-relative-goals --approach-share 0 --p-curric 0.2 --j 1 --N 8"
)
SETTINGS = {
    "quick": seeds.Setting(_EPOCHS, seeds=3, goals=50),
    "as-the-ramp": seeds.Setting(f"{_EPOCHS} {_RAMP}", seeds=3, goals=50),
}


def draw(folders: dict[str, list[Path]]) -> None:
    """Success over training, both settings."""
    comparison(folders, over="epoch").savefig(seeds.results_of(BODY) / "success.png", dpi=150)


if __name__ == "__main__":
    seeds.main(BODY, SETTINGS, draw, description=str(__doc__).splitlines()[0])
