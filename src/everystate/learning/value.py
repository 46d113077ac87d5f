"""Targets of the undiscounted value (4.3, eq. 2)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from everystate.config import Config


def backup(
    config: Config, near: Float[Array, ""], value: Float[Array, ""], floor: Float[Array, ""]
) -> Float[Array, ""]:
    """r + V_targ(s', g) with r = -1 + near (eq. 2).

    `bound_value` holds V_targ within [floor, 0], the values it can truly have [D4]. It does so
    here rather than in the network: an output through softplus, once at 0, stayed there.

    With `absorb_goal`, V_targ counts only for the share of s' that has not reached g: eq. 2's
    V(s, s) = 0 in proportion to the reward's partial credit [D10].
    """
    value = jnp.clip(value, floor, 0) if config.bound_value else value
    return near - 1 + ((1 - near) * value if config.absorb_goal else value)
