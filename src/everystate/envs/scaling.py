"""What makes a body's states about of unit size."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32


class Scaling(NamedTuple):
    """What makes a body's states about of unit size: (state - centre) / spread."""

    centre: Float32[np.ndarray, " state"]
    spread: Float32[np.ndarray, " state"]
    constant: Bool[np.ndarray, " state"]
    """Components that never changed under random actions."""


def scaling_of(
    nominal: tuple[Sequence[float] | Float[np.ndarray, " state"], ...],
    play: Callable[[], Float32[np.ndarray, "steps envs state"]],
) -> Scaling:
    """Centre and spread as they are given or, where they are NaN, as play has them."""
    centre, spread = (np.array(x, dtype=np.float64) for x in nominal)
    constant = np.zeros(centre.shape, dtype=bool)
    if np.isnan([centre, spread]).any():
        played = play()
        deviation = played.std(axis=(0, 1))
        constant = np.isnan(spread) & (deviation < 1e-6)
        centre = np.where(np.isnan(centre), played.mean(axis=(0, 1)), centre)
        spread = np.where(np.isnan(spread), np.where(constant, 1.0, deviation), spread)
    return Scaling(centre.astype(np.float32), spread.astype(np.float32), constant)
