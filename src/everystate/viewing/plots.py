"""One style for every figure, and the pictures that need only numbers.

Colours are those of Okabe and Ito, distinct to colour-blind eyes; series differ by line style or
hatching too, so that a grey print can be read.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from cycler import cycler
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

BLACK, GREY = "#000000", "#6b6b6b"
BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PURPLE, SKY, YELLOW = "#CC79A7", "#56B4E9", "#F0E442"
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, BLACK)
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)), "-")
WIDTH = 7.5  # inches: a page's text
DPI = 150
_SPIKE = 10.0
"""A value so many times larger than most is one."""

STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "axes.prop_cycle": cycler(color=COLOURS, linestyle=DASHES),
    "lines.linewidth": 1.6,
    "legend.frameon": False,
    "hatch.linewidth": 0.8,
    "figure.constrained_layout.use": True,
    "svg.hashsalt": "everystate",
}

_P = ParamSpec("_P")
Metrics = Mapping[str, Float[np.ndarray, " epochs"]]
"""Columns of metrics.jsonl; NaN where an epoch lacks one."""


def styled(draw: Callable[_P, Figure]) -> Callable[_P, Figure]:
    """Draws in our style and leaves the user's settings alone."""

    @functools.wraps(draw)
    def wrapper(*args: _P.args, **kwargs: _P.kwargs) -> Figure:
        with mpl.rc_context():
            mpl.rcdefaults()  # it leaves the backend as it is
            mpl.rcParams.update(STYLE)
            return draw(*args, **kwargs)

    return wrapper


def save(figure: Figure, path: Path) -> Path:
    """Writes a PNG that depends on nothing but the figure."""
    figure.savefig(path, dpi=DPI, metadata={"Software": None})
    return path


def columns(
    epochs: Sequence[Mapping[str, int | float]],
) -> dict[str, Float[np.ndarray, " epochs"]]:
    """Lines of metrics.jsonl as columns."""
    names = dict.fromkeys(name for line in epochs for name in line)
    missing = float("nan")
    return {n: np.array([line.get(n, missing) for line in epochs], dtype=float) for n in names}


def smooth(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """A centred moving mean over a thirtieth of the curve, over what there is at its ends."""
    half = len(values) // 60
    known = np.isfinite(values)
    window = np.ones(2 * half + 1)
    total = np.convolve(np.where(known, values, 0.0), window)[half : half + len(values)]
    count = np.convolve(known.astype(float), window)[half : half + len(values)]
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)


def curve(ax: Axes, x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], **style: Any) -> None:
    """A noisy curve: as it was, thin, and its moving mean."""
    (line,) = ax.plot(x, smooth(y), **style)
    if len(x) >= 60:
        ax.plot(x, y, color=line.get_color(), linestyle="-", linewidth=0.7, alpha=0.3)


def steps_axis(ax: Axes) -> None:
    """The x axis of everything over time."""
    ax.set_xlabel("control steps of all bodies")
    ax.set_xlim(left=0)
    ax.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    ax.xaxis.set_major_formatter(FuncFormatter(thousands))


def thousands(value: float, _: Any = None) -> str:
    """12000 as 12k, 3400000 as 3.4M."""
    if abs(value) >= 1e6:
        return f"{value / 1e6:g}M"
    return f"{value / 1e3:g}k" if abs(value) >= 1e3 else f"{value:g}"


@styled
def reached(ways: Mapping[str, Sequence[float]], near: str, verb: str) -> Figure:
    """Shares of goals by the tolerance at which they count: a curve for each way to act.

    Args:
        ways: name -> distance of every task from its goal, in σ.
        near: what a distance is, as "in every component".
        verb: what is done to the goals: "held", "passed".
    """
    figure = Figure(figsize=(WIDTH, 3.2))
    ax = figure.subplots()
    looks = {"policy": (BLUE, "-"), "planning": (ORANGE, "--")}
    others = iter(((RED, ":"), (GREY, "-.")))
    for name, distances in ways.items():
        at = np.sort(np.clip(distances, 0.01, None))
        color, dashes = looks.get(name) or next(others)
        share = np.arange(1, len(at) + 1) / len(at)
        x, y = np.r_[0.01, at, 10.0], np.r_[0.0, share, 1.0]
        ax.step(x, y, where="post", color=color, linestyle=dashes, label=name)
    ax.axvline(0.5, color=BLACK, linestyle="-", linewidth=0.8)
    ax.text(0.48, 0.02, "counts as reached", rotation=90, ha="right", va="bottom", fontsize=8)
    ax.set_xscale("log")
    ax.set_xlim(0.01, 10.0)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    ax.set_xlabel(f"tolerance, σ {near}")
    _percent(ax, f"goals {verb}")
    figure.legend(loc="outside upper right", ncols=4)
    return figure


@styled
def over_time(
    metrics: Metrics,
    panels: Sequence[tuple[str, Mapping[str, str]]],
    *,
    log: bool = False,
    share: Sequence[int] = (),
    columns: int = 2,
) -> Figure:
    """Curves over control steps.

    Args:
        metrics: columns of metrics.jsonl.
        panels: for each panel its title, and the curves in it: name of the metric -> label.
        log: logarithmic y axes.
        share: panels whose y axis is a share, shown in percent from 0 to 100.
        columns: panels beside each other.
    """
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(WIDTH, 2.4 * rows if rows > 1 else 2.7))
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for i, (ax, (title, curves)) in enumerate(zip(grid, panels, strict=False)):
        for name, label in curves.items():
            if name in metrics:
                known = np.isfinite(metrics[name])
                curve(ax, metrics["steps"][known], metrics[name][known], label=label)
        ax.set_title(title)
        steps_axis(ax)
        if log:
            ax.set_yscale("log")
        elif i in share:
            _percent(ax)
        else:
            _unflatten(ax, [metrics[name] for name in curves if name in metrics])
        if len(curves) > 1:
            ax.legend(fontsize=8)
    for ax in grid[len(panels) :]:
        ax.set_axis_off()
    return figure


def _percent(ax: Axes, label: str = "") -> None:
    """A y axis of shares."""
    ax.set_ylim(0, 1.02)
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:.0f} %"))
    ax.set_ylabel(label)


def _unflatten(ax: Axes, curves: Sequence[Float[np.ndarray, " n"]]) -> None:
    """Where a spike would flatten all else, a y axis that is logarithmic beyond what most keep."""
    values = np.concatenate([*curves, np.zeros(1)])
    values = values[np.isfinite(values)]
    most = float(np.percentile(np.abs(values), 90))
    if not np.abs(values).max() > _SPIKE * most > 0:
        return
    linear = 10.0 ** math.ceil(math.log10(most))
    ax.set_yscale("symlog", linthresh=linear)
    ax.set_ylim(1.5 * float(values.min()), 1.5 * float(values.max()))
    ax.set_ylabel(f"logarithmic beyond {linear:g}")
