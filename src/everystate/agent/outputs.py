"""What an agent answers with, in the units of its body."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Float32


class Unit(NamedTuple):
    """What a component of the state is scaled by: (value - centre) / spread."""

    centre: float
    spread: float
    """1 σ, by which goals are scored and distances shown."""


class Plan(NamedTuple):
    """What an agent means to do, and where it expects that to lead; in the units of the body."""

    actions: Float32[np.ndarray, "*n horizon action"]
    """In [-1, 1], one after the other, each for as many control steps as the agent's interval."""
    states: Float32[np.ndarray, "*n horizon+1 state"]
    """By the learned dynamics without their noise; the first is that from which it plans."""
    corrected: Bool[np.ndarray, "*n"]
    """Whether the search found better than the policy, which otherwise acts alone."""
    gain: Float32[np.ndarray, "*n"]
    """By how many steps what it found seems better, be it sure enough of that or not."""


def returned(values: Float[Array, "n *a"], single: bool) -> Float32[np.ndarray, "..."]:
    """The user's own array, without the batch axis that a single state was given."""
    return np.array(values[0] if single else values)
