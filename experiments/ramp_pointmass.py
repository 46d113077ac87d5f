"""Trains and evaluates several seeds on the Ramp Pointmass; keeps the raw results and a figure.

    python experiments/ramp_pointmass.py

`seeds.py` says where everything goes; the figure is `literal-against-quick.png`, and
`time-to-95.json` has the wall-clock of learning to reach 95 % of the suite's goals, on one core and
evaluations included.
"""

from pathlib import Path
from statistics import median

import seeds

from everystate.evaluation import raw
from everystate.training.logging import read_metrics
from everystate.viewing.figures import comparison

# `literal` at the sizes of `quick`, as its own would take a day: it lacks the stabilisers, and what
# else `quick` adds to the paper (docs/algorithm.md, section 4).
_SIZES = {
    "batch_size": 256,
    "N": 8,
    "width": 128,
    "depth": 3,
    "state_layers": 6,
    "curriculum_layers": 6,
    "capacity": 100_000,
    "epochs": 60,
}
SETTINGS = {
    "quick": seeds.Setting({}, seeds=5),
    "literal": seeds.Setting(_SIZES, seeds=3, preset="literal"),
}


def draw(folders: dict[str, list[Path]]) -> None:
    """Success over training, and how long it took."""
    results = seeds.results_of("ramp-pointmass")
    comparison(folders, over="epoch").savefig(results / "literal-against-quick.png", dpi=150)
    times = [time_to(0.95, folder) for folder in folders["quick"]]
    said = {"seconds": times, "median": median(times)}
    raw.write(results / "time-to-95.json", said, replace=True)


def time_to(share: float, folder: Path) -> float:
    """Seconds from the start until an evaluation on the suite first had that share of goals."""
    for line in read_metrics(folder):
        if line.get("eval/success@0.5/all", 0) >= share:
            return line["time/elapsed_s"]
    return float("inf")


if __name__ == "__main__":
    seeds.main("ramp-pointmass", SETTINGS, draw, description=str(__doc__).splitlines()[0])
