"""Trains and evaluates several seeds on the Ramp Pointmass; keeps the raw results and a figure.

    python experiments/ramp_pointmass.py

`seeds.py` says where everything goes; the figure is `literal-against-quick.png`.
"""

from pathlib import Path

import seeds

from everystate.viewing.figures import comparison

# `literal` at the sizes of `quick`, as its own would take a day: it lacks the stabilisers, and what
# else `quick` adds to the paper (docs/algorithm.md, section 4).
_SIZES = (
    "--batch-size 256 --N 8 --width 128 --depth 3 --state-layers 6 --curriculum-layers 6"
    " --capacity 100000 --epochs 60"
)
SETTINGS = {
    "quick": seeds.Setting("--preset quick", seeds=5),
    "literal": seeds.Setting(f"--preset literal {_SIZES}", seeds=3),
}


def draw(folders: dict[str, list[Path]]) -> None:
    """Success over training, both settings."""
    figure = comparison(folders, over="epoch")
    figure.savefig(seeds.results_of("ramp-pointmass") / "literal-against-quick.png", dpi=150)


if __name__ == "__main__":
    seeds.main("ramp-pointmass", SETTINGS, draw, description=str(__doc__).splitlines()[0])
