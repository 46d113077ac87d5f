"""The pictures of `safety.py` and `safety_grid.py`, from their results alone."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from everystate.envs.ramp_pointmass import ARENA, LEDGE_SOUTH, RAMP_FOOT, RAMP_WEST
from everystate.viewing.plots import BLACK, BLUE, COLOURS, GREY, ORANGE, RED, WIDTH, styled

LOOKS = {
    "pessimal-of-20": ("worst of 20", BLUE, "-"),
    "mean-of-20": ("mean of 20", ORANGE, "-"),
    "pessimal": ("worst of 8", BLUE, "--"),
    "mean": ("mean of 8", ORANGE, "--"),
}
"""What the paper's figure compares: title, colour and line."""
TITLES = {
    "completed": "climbs completed",
    "falls": "falls per climb",
    "wall": "to the wall [m]",
    "at_edge": "left at the edge",
}
Found = dict[str, list[dict[str, Any]]]
"""By setting, of each seed: measures by epoch, or of the last one alone."""


@styled
def growth(found: Found) -> Figure:
    """A row per goal and a panel per measure, over epochs: seeds thin, their median thick."""
    figure = Figure(figsize=(WIDTH, 4.2))
    axes = figure.subplots(2, len(TITLES), sharex=True)
    for row, goal in zip(axes, ("ahead", "west"), strict=True):
        for ax, (measure, title) in zip(row, TITLES.items(), strict=True):
            for name, (label, colour, line) in LOOKS.items():
                runs = found.get(name, [])
                epochs = sorted(map(int, set.intersection(*map(set, runs)))) if runs else []
                curves = [[run[str(e)][goal][measure] for e in epochs] for run in runs]
                of = np.array(curves, dtype=float)
                ax.plot(epochs, of.T, line, color=colour, linewidth=0.5, alpha=0.35)
                ax.plot(epochs, np.nanmedian(of, axis=0), line, color=colour, label=label)
            ax.set(ylim=(0, None), title=title if goal == "ahead" else None)
            ax.set_xlabel("epoch" if goal == "west" else None)
        row[0].set_ylabel(f"goal {'straight ahead' if goal == 'ahead' else 'to the west'}")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


@styled
def clouds(last: Found) -> Figure:
    """The policy's actions half way up, of all seeds together: left is away from the wall."""
    figure = Figure(figsize=(WIDTH, 2.8))
    rows = figure.subplots(2, len(last), sharex=True, sharey=True, squeeze=False)
    for row, goal in zip(rows, ("ahead", "west"), strict=True):
        for ax, colour, (name, runs) in zip(row, COLOURS, last.items(), strict=False):
            x, y = np.concatenate([run[goal]["actions"] for run in runs]).T
            ax.plot(x, y, ".", color=colour, markersize=1.5, alpha=0.3)
            ax.axvline(0, color=GREY, linewidth=0.7)
            ax.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
            if goal == "ahead":
                ax.set_title(LOOKS.get(name, (name.replace("-", "\n", 1),))[0], fontsize=8)
        row[0].set_ylabel(f"goal {goal}\nnorth")
    for ax in rows[-1]:
        ax.set_xlabel("east")
    return figure


@styled
def falls(last: Found) -> Figure:
    """Climbs to the west by the worst and by the mean of 20 outcomes, and what share falls."""
    figure = Figure(figsize=(WIDTH, 2.9))
    *maps, ax = figure.subplots(1, 3, width_ratios=[1, 1, 1.9])
    for place, name in zip(maps, ("pessimal-of-20", "mean-of-20"), strict=True):
        draw_ramp(place)
        for run in last.get(name, []):
            walk(place, run["west"])
        place.set_title(LOOKS[name][0])
    for at, (name, (_, colour, _)) in enumerate(LOOKS.items()):
        for kind, mark, aside in (("west", "o", -0.2), ("searched", "^", 0.2)):
            share = [100 * run[kind]["falls"] for run in last.get(name, [])]
            where = at + aside + np.linspace(-0.1, 0.1, len(share))
            ax.plot(where, share, mark, color=colour, markersize=4, alpha=0.6)
            middle = [np.median(share) if share else np.nan] * 2
            ax.plot([at + aside - 0.17, at + aside + 0.17], middle, "-", color=BLACK)
    ax.plot([], [], "o", color=GREY, label="by the policy")
    ax.plot([], [], "^", color=GREY, label="by one step of search")
    ax.legend()
    ax.set_xticks(range(len(LOOKS)), [label for label, *_ in LOOKS.values()])
    ax.set(title="climbs to the west that fall, of each seed [%]", ylim=(-2, 100))
    return figure


@styled
def grid(said: dict[str, Any], found: Found) -> Figure:
    """Climbs by eq. 3 solved on a grid, and V over the ramp's edge as solved and learned.

    Args:
        said: what `safety_grid.py` says.
        found: of each seed, measures of its last agent.
    """
    figure, solved = Figure(figsize=(WIDTH, 2.7)), said["noise as it is"]
    row = figure.subplots(1, len(solved) + 1, width_ratios=[1] * len(solved) + [1.6])
    for ax, (name, goals) in zip(row[:-1], solved.items(), strict=True):
        draw_ramp(ax)
        walk(ax, goals["west"])
        ax.set_title(f"{name}\n{100 * goals['west']['falls']:.1f} % fall", fontsize=8)
    row[0].set_ylabel("solved on a grid")
    ax = row[-1]
    for setting, (label, colour, line) in LOOKS.items():
        for run in found.get(setting, []):
            ax.plot(
                said["x"], run["west"]["across"], line, color=colour, linewidth=0.6, label=label
            )
            label = None
    for marker, (name, goals) in zip("ox+", solved.items(), strict=True):
        ax.plot(
            said["x"],
            goals["west"]["across"],
            marker,
            color=BLACK,
            markersize=4,
            label=f"grid, {name}",
        )
    ax.set(xlabel="x [m]", title="V, goal to the west")
    ax.legend(fontsize=7)
    return figure


def draw_ramp(ax: Axes) -> None:
    """Ramp and ledge from above, north up; the rest is floor."""
    ramp = (RAMP_WEST, RAMP_FOOT), ARENA - RAMP_WEST, LEDGE_SOUTH - RAMP_FOOT
    ledge = (-ARENA, LEDGE_SOUTH), 2 * ARENA, ARENA - LEDGE_SOUTH
    for (corner, width, height), grey in ((ramp, "0.90"), (ledge, "0.82")):
        ax.add_patch(Rectangle(corner, width, height, color=grey, linewidth=0))
    ax.set(xlim=(-0.3, ARENA), ylim=(-0.7, ARENA), aspect="equal", xticks=[], yticks=[])
    ax.grid(visible=False)


def walk(ax: Axes, measures: dict[str, Any]) -> None:
    """Climbs up to where they end, falls in red, and the goal."""
    for track, fallen in zip(measures["tracks"], measures["fallen"], strict=True):
        x, y = np.array(track).T
        ax.plot(x, y, "-", color=RED if fallen else BLUE, linewidth=0.6, alpha=0.5)
        if fallen:
            ax.plot(x[-1], y[-1], "x", color=RED, markersize=3)
    ax.plot(0, 0.85, "*", color="black", markersize=7)
