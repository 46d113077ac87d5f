"""Dynamics that a test knows, in the place of learned ones."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from everystate.learning.dynamics import Dynamics
from everystate.learning.flows import decode


class Known(Dynamics):
    """d(s'|s, a) by a function that gives its distribution; all components count."""

    outcomes: Callable[..., Any] | None = eqx.field(static=True)

    def __init__(self, outcomes: Callable[..., Any] | None = None, size: int = 2) -> None:
        """Of states with so many components."""
        self.change: Any = None
        self.change_scale, self.weights = jnp.ones(size), jnp.ones(size)
        self.outcomes, self.horizontal = outcomes, ()

    def __call__(self, state: Any, action: Any) -> Any:
        """The distribution of s'."""
        assert self.outcomes
        return self.outcomes(state, action)

    def central(self, state: Any, action: Any) -> Any:
        """Its centre."""
        return decode(self(state, action), jnp.zeros_like(state))
