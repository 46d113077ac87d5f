"""Several runs in one figure, drawn from their result files alone.

Of each run's folder it reads `metrics.jsonl` and, if it is there, `evaluation.json`, or else the
one in the run's report.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from everystate.errors import EverystateError
from everystate.training.logging import read_metrics
from everystate.viewing.plots import (
    COLOURS,
    DASHES,
    WIDTH,
    columns,
    smooth,
    styled,
    thousands,
)

Over = Literal["epoch", "steps", "minutes"]
_LABELS: dict[Over, str] = {
    "epoch": "epoch",
    "steps": "control steps of all bodies",
    "minutes": "minutes of training",
}
_MARKERS = "osD^vP*"

Run = Mapping[str, Float[np.ndarray, " epochs"]]


@styled
def comparison(groups: Mapping[str, Sequence[Path | str]], *, over: Over = "steps") -> Figure:
    """Settings compared: coverage, training goals reached, and success by region.

    A group is one setting, its runs the seeds: thin lines are single runs, thick ones their median.
    A cross marks where a run ended before the longest of all; in the median it keeps its last
    value, as leaving it out would flatter a setting whose worst runs break down. Success is a
    curve where runs were evaluated while training, otherwise a mark per run at its end.

    Args:
        groups: label -> run folders.
        over: the x axis.
    """
    runs = {label: [_read(Path(folder)) for folder in folders] for label, folders in groups.items()}
    finals = {label: [_final(Path(f)) for f in folders] for label, folders in groups.items()}
    if not any(runs.values()):
        raise EverystateError("no runs to compare")
    regions = list(dict.fromkeys(r for group in finals.values() for f in group for r in f))
    evaluated = scores([name for group in runs.values() for run in group for name in run])
    panels = {"coverage/cells": "cells visited", "episode/reached": "training goals reached"}
    panels |= {
        name: f"suite {suite}, {group}"
        for suite, labels in evaluated.items()
        for name, group in labels.items()
    }
    known = {name for group in runs.values() for run in group for name in run}
    panels = {name: title for name, title in panels.items() if name in known}
    bars = bool(regions) and not evaluated
    rows = -(-(len(panels) + bars) // 2)
    figure = Figure(figsize=(WIDTH, 2.5 * rows + 0.3))
    grid = figure.subplots(rows, 2, squeeze=False).ravel()
    longest = max(float(_axis(run, over)[-1]) for group in runs.values() for run in group)
    for ax, (metric, title) in zip(grid, panels.items(), strict=False):
        for i, (label, group) in enumerate(runs.items()):
            _group(ax, [(_axis(run, over), run.get(metric)) for run in group], i, label, longest)
        ax.set_title(title)
        ax.set_xlabel(_LABELS[over])
        ax.set_xlim(0, longest * 1.02)
        ax.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        if over == "steps":
            ax.xaxis.set_major_formatter(FuncFormatter(thousands))
        _percent(ax)
    if bars:
        _marks(grid[len(panels)], finals, regions)
    for ax in grid[len(panels) + bars :]:
        ax.set_axis_off()
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(len(groups), 4))
    return figure


def scores(names: Iterable[str]) -> dict[str, dict[str, str]]:
    """What training logs of its evaluations: `[suite][column] = group`.

    Of a suite with ks those and `all`; of any other every group.
    """
    found: dict[str, dict[str, str]] = {}
    for name in dict.fromkeys(names):
        if name.startswith("eval/") and "/score/" in name:
            _, suite, _, group = name.split("/", 3)
            found.setdefault(suite, {})[name] = group
    for suite, labels in found.items():
        ks = {n: group for n, group in labels.items() if group.startswith("k=") or group == "all"}
        found[suite] = ks if len(ks) > 1 else labels
    return found


@styled
def settings(groups: Mapping[str, Sequence[Path | str]]) -> Figure:
    """Scores in the end, by suite and group: a row per setting, too many for curves.

    Dots are seeds, bars their median; the dashed line is the first setting's, which is on top, and
    the others follow from best to worst in the first panel.

    Args:
        groups: label -> folders with an `evaluation.json`.
    """
    finals = {label: [_final(Path(f)) for f in folders] for label, folders in groups.items()}
    regions = list(dict.fromkeys(r for group in finals.values() for f in group for r in f))
    if not regions:
        raise EverystateError("no evaluation.json: run `everystate evaluate`")
    first, *others = finals
    others.sort(key=lambda label: -np.median([one[regions[0]] for one in finals[label]]))
    finals = {label: finals[label] for label in (first, *others)}
    figure = Figure(figsize=(WIDTH, 0.9 + 0.22 * len(finals)))
    panels = figure.subplots(1, len(regions), sharey=True, squeeze=False)[0]
    for ax, region in zip(panels, regions, strict=True):
        for row, found in enumerate(finals.values()):
            values = [100 * one[region] for one in found]
            ax.plot(np.median(values), row, "|", color=COLOURS[0], markersize=12, mew=2.5)
            ax.plot(values, [row] * len(values), "o", color=COLOURS[0], markersize=4, alpha=0.5)
        ax.axvline(
            100 * float(np.median([one[region] for one in finals[first]])),
            color=COLOURS[-1],
            linestyle="--",
            linewidth=1,
        )
        ax.set_title(region)
        ax.set_xlim(-4, 104)
        ax.set_xlabel("%")
        ax.set_yticks(range(len(finals)), finals)
    figure.axes[0].set_ylim(len(finals) - 0.5, -0.5)  # the first on top
    return figure


def _read(folder: Path) -> dict[str, Float[np.ndarray, " epochs"]]:
    found = columns(read_metrics(folder))
    if "epoch" not in found:
        raise EverystateError(f"{folder} has no metrics.jsonl with an epoch in it")
    return found


def _final(folder: Path) -> dict[str, float]:
    """Scores of the first suite by group and of others over all; empty without evaluation.json."""
    paths = [folder / "evaluation.json", folder / "report" / "evaluation.json"]
    path = next((path for path in paths if path.exists()), None)
    if path is None:
        return {}
    result: dict[str, Any] = json.loads(path.read_text())
    found: dict[str, float] = {}
    for name, suite in result["suites"].items():
        score = suite["policy"]["score"]
        found |= {f"{name}, all": score["all"]} if found else score
    return found


def _axis(run: Run, over: Over) -> Float[np.ndarray, " epochs"]:
    return run["time/elapsed_s"] / 60 if over == "minutes" else run[over]


def _group(
    ax: Axes,
    curves: Sequence[tuple[np.ndarray, np.ndarray | None]],
    index: int,
    label: str,
    longest: float,
) -> None:
    colour, dashes = COLOURS[index % len(COLOURS)], DASHES[index % len(DASHES)]
    known = []
    for x, y in curves:
        keep = np.zeros(0, dtype=int) if y is None else np.flatnonzero(np.isfinite(y))
        if y is None or not keep.size:
            continue
        x, y = x[keep], smooth(y[keep])
        known.append((x, y))
        ax.plot(x, y, color=colour, linestyle="-", linewidth=0.7, alpha=0.45)
        if x[-1] < 0.97 * longest:
            ax.plot(x[-1], y[-1], marker="x", color=colour, linestyle="none", markersize=5)
    if known:
        begin = max(x[0] for x, _ in known)
        common = np.linspace(begin, max(x[-1] for x, _ in known), 300)
        median = np.median([np.interp(common, x, y) for x, y in known], axis=0)
        ax.plot(common, median, color=colour, linestyle=dashes, linewidth=2.0, label=label)


def _marks(
    ax: Axes, finals: Mapping[str, Sequence[Mapping[str, float]]], regions: Sequence[str]
) -> None:
    """Per region and group a mark for each run and a bar at their median."""
    width = 0.8 / len(finals)
    for i, group in enumerate(finals.values()):
        colour, marker = COLOURS[i % len(COLOURS)], _MARKERS[i % len(_MARKERS)]
        for at, region in enumerate(regions):
            values = [final[region] for final in group if region in final]
            if not values:
                continue
            x = at + (i - (len(finals) - 1) / 2) * width
            spread = x + width * 0.5 * (np.arange(len(values)) / max(1, len(values) - 1) - 0.5)
            ax.plot(spread, values, marker, color=colour, markersize=4, linestyle="none", alpha=0.8)
            ax.hlines(np.median(values), x - 0.4 * width, x + 0.4 * width, color=colour, lw=2.2)
    ax.set_xticks(range(len(regions)), regions)
    ax.set_title("scores, when finished")
    ax.grid(axis="x", visible=False)
    _percent(ax)


def _percent(ax: Axes) -> None:
    ax.set_ylim(-0.03, 1.03)
    ax.set_yticks(np.linspace(0, 1, 6), [f"{p} %" for p in range(0, 101, 20)])
