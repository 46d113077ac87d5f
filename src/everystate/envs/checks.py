"""What bodies are given and give is refused, with the value named, where it is not as it must."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from everystate.errors import EverystateError

_TOLERANCE = 1e-6  # what rounding may carry an action beyond [-1, 1]


def checked_seed(seed: int) -> int:
    """The seed, if it is one."""
    if not 0 <= seed < 2**64:
        raise EverystateError(f"seed is {seed}: choose a whole number from 0 to 2^64 - 1")
    return seed


def checked_actions(
    actions: Float[np.ndarray, "..."], shape: tuple[int, ...]
) -> Float[np.ndarray, "envs action"]:
    """The actions, if they are of this shape and lie in [-1, 1]."""
    actions = np.asarray(actions, dtype=np.float64)
    if actions.shape != shape:
        raise EverystateError(f"actions have shape {actions.shape}: expected {shape}")
    largest = np.abs(actions).max()
    if not largest <= 1.0 + _TOLERANCE:
        bad = tuple(np.argwhere(~(np.abs(actions) <= 1.0 + _TOLERANCE))[0])
        what = "lie in [-1, 1]: clip it" if math.isfinite(actions[bad]) else "be finite"
        raise EverystateError(
            f"action of environment {bad[0]} is {actions[bad]} in component {bad[1]}:"
            f" it must {what}"
        )
    return np.clip(actions, -1.0, 1.0) if largest > 1.0 else actions


def require_finite(observations: Float[np.ndarray, "envs state"], names: Sequence[str]) -> None:
    """Raises an error that names the first value that is not finite."""
    if not np.isfinite(observations).all():
        env, component = np.argwhere(~np.isfinite(observations))[0]
        raise EverystateError(
            f"observation of environment {env} is {observations[env, component]} in"
            f" {names[component]}: it must be finite"
        )
