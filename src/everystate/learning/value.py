"""Targets and losses of the undiscounted value (4.3, eq. 2)."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from everystate.config import Config


def backup(
    config: Config, near: Float[Array, ""], value: Float[Array, ""], floor: Float[Array, ""]
) -> Float[Array, ""]:
    """r + V_targ(s', g) with r = -1 + near (eq. 2), held within [floor, 0] when bounded [D4].

    With `absorb_goal`, V_targ counts only for the share of s' that has not reached g: eq. 2's
    V(s, s) = 0 in proportion to the reward's partial credit [D10].
    """
    remaining = (1 - near) * value if config.absorb_goal else value
    target = near - 1 + remaining
    return jnp.clip(target, floor, 0) if config.bound_value else target


def value_loss(
    config: Config,
    value: Callable,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    targets: Float[Array, " batch"],
) -> Float[Array, ""]:
    """Mean of (V(s, g) - v_targ)^2 + V(g, g)^2 (Algorithm 1)."""
    errors = jax.vmap(value)(states, goals) - targets
    at_goals = jax.vmap(value)(goals, goals)
    return jnp.mean(errors**2) + config.goal_value_weight * jnp.mean(at_goals**2)
