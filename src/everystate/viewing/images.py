"""Pictures made of pictures, and curves as pixels: what films and the studio show."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Float, Int, UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from everystate.viewing.plots import DPI, ORANGE, RED, WIDTH, styled


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
