"""Worlds that differ from the one an agent learned in, and what is said of success in them."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

GRID: tuple[dict[str, float], ...] = tuple(
    {"mass": mass, "force": force, "action_noise": noise}
    for mass, force, noise in itertools.product((1.0, 0.8, 1.25), (1.0, 0.8, 1.25), (0.0, 0.1, 0.2))
)
"""Options of a body: masses and motor forces by these factors, and noise on its actions, beyond
what it has by itself. The first is the world as it is."""


def summarised(success: Sequence[float]) -> dict[str, Any]:
    """Of the success in each world of `GRID`, in order.

    `cvar10` is the mean over the worst tenth of the worlds, rounded up to whole worlds.
    """
    worst_first = np.sort(success)
    tenth = worst_first[: math.ceil(len(success) / 10)]
    return {
        "nominal": success[0],
        "mean": float(np.mean(success)),
        "cvar10": float(tenth.mean()),
        "worst": float(worst_first[0]),
        "worlds": [{**world, "success": s} for world, s in zip(GRID, success, strict=True)],
    }
