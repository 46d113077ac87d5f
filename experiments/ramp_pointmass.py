"""Trains and evaluates several seeds on the Ramp Pointmass; keeps the raw results and a figure.

    python experiments/ramp_pointmass.py

`seeds.py` says where everything goes; the figures are `literal-against-quick.png` and
`quick-before-and-after.png`, and `time-to-95.json` has the wall-clock of learning to reach 95 % of
the suite's goals, on one core and evaluations included.
"""

import json
from pathlib import Path
from statistics import median

import seeds

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
    # `quick` by the update as it was before candidates were dropped early (docs/performance.md):
    # kept to show that it learned the same. It cannot be trained again by this code.
    "before-early-dropping": seeds.Setting({}, seeds=0),
    "literal": seeds.Setting(_SIZES, seeds=3, preset="literal"),
}


def draw(folders: dict[str, list[Path]]) -> None:
    """Success over training, and how long it took."""
    results = seeds.results_of("ramp-pointmass")
    for file, names in (
        ("literal-against-quick.png", ("quick", "literal")),
        ("quick-before-and-after.png", ("quick", "before-early-dropping")),
    ):
        figure = comparison({name: folders[name] for name in names}, over="epoch")
        figure.savefig(results / file, dpi=150)
    times = [time_to(0.95, folder) for folder in folders["quick"]]
    said = {"seconds": times, "median": median(times)}
    (results / "time-to-95.json").write_text(json.dumps(said, indent=1) + "\n")


def time_to(share: float, folder: Path) -> float:
    """Seconds from the start until an evaluation on the suite first had that share of goals."""
    for line in read_metrics(folder):
        if line.get("eval/success@0.5/all", 0) >= share:
            return line["time/elapsed_s"]
    return float("inf")


if __name__ == "__main__":
    seeds.main("ramp-pointmass", SETTINGS, draw, description=str(__doc__).splitlines()[0])
