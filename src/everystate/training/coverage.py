"""Which part of its space a body has visited, on a fixed grid over the body's bounds."""

import numpy as np
from jaxtyping import Bool, Float

CELLS = 20  # Per dimension.
MAX_DIMENSIONS = 3


def no_cells(
    low: Float[np.ndarray, " s"], high: Float[np.ndarray, " s"]
) -> Bool[np.ndarray, "..."]:
    """A grid without visits; an empty array for a body of too many or unbounded dimensions."""
    if low.size > MAX_DIMENSIONS or not np.isfinite([low, high]).all():
        return np.zeros(0, dtype=bool)
    return np.zeros((CELLS,) * low.size, dtype=bool)


def visit(
    visited: Bool[np.ndarray, "..."],
    states: Float[np.ndarray, "*n s"],
    low: Float[np.ndarray, " s"],
    high: Float[np.ndarray, " s"],
) -> Bool[np.ndarray, "..."]:
    """The grid with these states' cells added; states beyond the bounds count at the border."""
    if not visited.size:
        return visited
    cells = np.clip(((states - low) / (high - low) * CELLS).astype(int), 0, CELLS - 1)
    visited = visited.copy()
    visited[tuple(np.moveaxis(cells, -1, 0))] = True
    return visited
