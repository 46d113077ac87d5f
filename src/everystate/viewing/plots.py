"""One style for every figure, and the pictures that need only numbers.

Colours are those of Okabe and Ito, distinct to colour-blind eyes; series differ by line style or
hatching too, so that a grey print can be read.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from cycler import cycler
from jaxtyping import Float, Int, UInt8
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from everystate.evaluation.metrics import EPS

BLACK, GREY = "#000000", "#6b6b6b"
BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PURPLE, SKY, YELLOW = "#CC79A7", "#56B4E9", "#F0E442"
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, BLACK)
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)), "-")
WIDTH = 7.5  # inches: a page's text
DPI = 150

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
def success_by_group(suite: Mapping[str, Any]) -> Figure:
    """Of one suite of a result: a panel per tolerance, a pair of bars per group of tasks."""
    figure = Figure(figsize=(WIDTH, 2.7))
    panels = figure.subplots(1, len(EPS), sharey=True, squeeze=False)[0]
    measure, reading = suite["scored_by"].removesuffix("@0.5").split(", ")
    groups = list(suite["policy"]["score"])
    by_k = any(name.startswith("k=") for name in groups)
    if by_k:  # the kinds would not find room beside them
        groups = [name for name in groups if name.startswith("k=") or name == "all"]
    at = np.arange(len(groups))
    columns = {"policy": suite["policy"], "with planning": suite["planning"]}
    shown = {name: one["success"][measure] for name, one in columns.items() if one}
    width = 0.8 / len(shown)
    looks = ({"color": BLUE}, {"color": ORANGE, "hatch": "////", "edgecolor": "white"})
    for ax, eps in zip(panels, EPS, strict=True):
        for i, (name, table) in enumerate(shown.items()):
            heights = [table[group][f"{eps:g}"][reading] for group in groups]
            left = at + (i - (len(shown) - 1) / 2) * width
            bars = ax.bar(left, heights, width * 0.94, label=name, **looks[i])
            ax.bar_label(bars, [f"{100 * h:.0f}" for h in heights], fontsize=6, padding=1)
        ax.set_title(f"within {eps:g} σ")
        ax.set_xticks(at, [name.removeprefix("k=") for name in groups])
        ax.set_xlabel("k, steps from start to goal" if by_k else "")
        ax.grid(axis="x", visible=False)
        ax.set_ylim(0, 1.08)
        ax.set_yticks(np.linspace(0, 1, 6), [f"{p} %" for p in range(0, 101, 20)])
    what = "goals passed" if reading == "hit" else "goals held at the last step"
    panels[0].set_ylabel(what + (" (rms)" if measure == "rms" else ""))
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
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
        if i in share:
            ax.set_ylim(0, 1.02)
            ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:.0f} %"))
        if len(curves) > 1:
            ax.legend(fontsize=8)
    for ax in grid[len(panels) :]:
        ax.set_axis_off()
    return figure


@styled
def filmstrip(frames: Sequence[np.ndarray], titles: Sequence[str], *, columns: int = 3) -> Figure:
    """Pictures in reading order, each with what it shows above it."""
    rows = -(-len(frames) // columns)
    height, width = frames[0].shape[:2]
    panel = WIDTH / columns
    figure = Figure(figsize=(WIDTH, rows * (panel * height / width + 0.25)))
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax in grid:
        ax.set_axis_off()
    for ax, frame, title in zip(grid, frames, titles, strict=False):
        ax.imshow(frame)
        ax.set_title(title, fontsize=8)
    return figure


@styled
def _curves(panels: Mapping[str, Float[np.ndarray, " steps"]], width: int, height: int) -> Figure:
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
    for ax, (title, values) in zip(figure.subplots(1, len(panels)), panels.items(), strict=True):
        ax.plot(values, linewidth=1)
        ax.set_title(title, fontsize=5, pad=2)
        ax.tick_params(labelsize=4, length=2, pad=1)
        ax.set_xticks([])
        ax.set_xlim(0, max(len(values) - 1, 1))
        ax.set_ylim(bottom=min(0.0, float(values.min())))
    return figure


def strip(
    panels: Mapping[str, Float[np.ndarray, " steps"]], width: int, height: int
) -> tuple[UInt8[np.ndarray, "height width 3"], Int[np.ndarray, "steps panels"]]:
    """Curves beside each other as pixels, and for every step its pixel column in each of them."""
    figure = _curves(panels, width, height)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    steps = np.arange(len(next(iter(panels.values()))))
    points = np.stack([steps, np.zeros(len(steps))], axis=1)
    at = [ax.transData.transform(points)[:, 0] for ax in figure.axes]
    pixels = np.asarray(canvas.buffer_rgba())[..., :3]
    return pixels.copy(), np.clip(np.stack(at, axis=1).round().astype(int), 0, width - 1)


def value_image(
    agent: Any,
    low: Float[np.ndarray, " 2"],
    high: Float[np.ndarray, " 2"],
    goal: Float[np.ndarray, " 2"],
    *,
    pixels: int = 200,
) -> UInt8[np.ndarray, "pixels pixels 3"]:
    """V of every place of a flat world, light where the goal is near; and goals it proposes."""
    cells = pixels // 4
    axes = [np.linspace(a, b, cells, dtype=np.float32) for a, b in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    steps = np.asarray(agent.steps_to_goal(places, goal)).reshape(cells, cells)
    shade = 1 - steps / max(float(steps.max()), 1.0)
    picture = (mpl.colormaps["viridis"](shade.repeat(4, axis=0).repeat(4, axis=1))[..., :3]) * 255
    for colour, size, marks in ((ORANGE, 2, agent.propose_goals(40)), (RED, 5, goal[None])):
        rgb = 255 * np.array(to_rgb(colour))
        for x, y in ((marks - low) / (high - low) * pixels).astype(int):
            picture[max(y - size, 0) : max(y + size, 0), max(x - size, 0) : max(x + size, 0)] = rgb
    return picture[::-1].astype(np.uint8)
