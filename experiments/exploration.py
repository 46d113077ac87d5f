"""Does choosing unlikely goals speed exploration (Fig. 3, right)?

    python experiments/exploration.py

The paper's least likely of 20 decoded goals against goals from the state distribution itself, on
the Ramp Pointmass at preset `quick`, as `exploration.toml` has it: how far up the ramp any body has
come, and when one first stood on the ledge, in control steps of all bodies. Runs and summary are in
results/exploration; how far each run came is in its `furthest.json`, the figure and intervals in
`furthest.png` and `.json`.
"""

import json
from pathlib import Path

import numpy as np
import seeds
from matplotlib.figure import Figure

from everystate.envs.ramp_pointmass import LEDGE_SOUTH, RAMP_FOOT, RAMP_WEST, region
from everystate.evaluation import raw
from everystate.evaluation.aggregate import summary
from everystate.studies import Study
from everystate.training.collection import read_samples
from everystate.training.logging import read_metrics
from everystate.viewing.plots import COLOURS, WIDTH, styled

NAME = "exploration"
Curve = dict[str, list[float]]


def furthest(run: Path) -> Curve:
    """After each epoch: steps, and the share of the ramp below the highest place a body was at.

    Of each epoch 500 of 2,500 states are known. 1 is the ramp's upper end, or the ledge.
    """
    steps, share = [], [0.0]
    for line in read_metrics(run):
        states = read_samples(run / "samples" / f"{int(line['epoch']):06d}.npz")[
            "next_observations"
        ]
        x, y = states.T
        climbed = np.where(
            region(states) == "ledge", 1, (y - RAMP_FOOT) / (LEDGE_SOUTH - RAMP_FOOT)
        )
        up = np.where((x >= RAMP_WEST) | (climbed == 1), climbed, 0)
        steps.append(float(line["steps"]))
        share.append(max(share[-1], float(np.clip(up, 0, 1).max())))
    return {"steps": steps, "share": share[1:]}


def first_on_the_ledge(curve: Curve) -> float:
    """Control steps until then; those of the whole run where nobody came there."""
    there = [n for n, s in zip(curve["steps"], curve["share"], strict=True) if s == 1]
    return there[0] if there else curve["steps"][-1]


def draw(study: Study, results: Path) -> None:
    """Reads what the runs on this machine have to say, then draws from the results alone."""
    folders = seeds.summarised(study, results)
    for found in folders.values():
        for folder in found:
            run = folder / "run"
            if not (folder / "furthest.json").exists() and run.exists():
                raw.write(folder / "furthest.json", furthest(run))
    curves: dict[str, list[Curve]] = {
        condition: [json.loads((folder / "furthest.json").read_text()) for folder in found]
        for condition, found in folders.items()
    }
    said = {
        condition: {"steps_to_ledge": summary([first_on_the_ledge(c) for c in found])}
        for condition, found in curves.items()
    }
    raw.write(results / "furthest.json", said, replace=True)
    figure(curves).savefig(results / "furthest.png", dpi=150)


@styled
def figure(curves: dict[str, list[Curve]]) -> Figure:
    """Every seed thin, the median of a condition thick."""
    drawn = Figure(figsize=(WIDTH * 0.7, 2.8))
    ax = drawn.subplots()
    for colour, (condition, found) in zip(COLOURS, curves.items(), strict=False):
        for curve in found:
            ax.plot(curve["steps"], curve["share"], color=colour, linewidth=0.7, alpha=0.5)
        middle = np.median([curve["share"] for curve in found], axis=0)
        ax.plot(found[0]["steps"], middle, color=colour, linewidth=2, label=condition)
    ax.set(xlabel="control steps of all bodies", ylabel="furthest up the ramp", ylim=(0, 1.05))
    ax.legend(loc="lower right")
    return drawn


if __name__ == "__main__":
    seeds.main(NAME, draw, description=str(__doc__))
