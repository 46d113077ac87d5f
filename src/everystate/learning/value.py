"""What counts in the value of what comes after (4.3, eq. 2), and the steps a value stands for."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from everystate.hyperparameters import Returns


def remaining(config: Returns, near: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The share of what comes after s' that counts.

    With `absorb`, V_targ counts only for the share of s' that has not reached g, or gone on from
    it: eq. 2's V(s, s) = 0 in proportion to the reward's partial credit [D10]. `discount` [D18].
    """
    return config.discount * (1 - config.absorb * near)


def bounded(
    config: Returns, value: Float[Array, "*n"], floor: Float[Array, ""]
) -> Float[Array, "*n"]:
    """V_targ within what it can truly be."""
    return jnp.clip(value, floor, 0) if config.bound_value else value


def lowest(config: Returns, copies: Int[Array, ""]) -> Float[Array, ""]:
    """The least that V_targ can truly be after so many copies: -1 at each of as many steps [D4]."""
    count = copies.astype(jnp.float32)
    if config.discount == 1:
        return -count
    return (config.discount**count - 1) / (1 - config.discount)


def steps(config: Returns, value: Float[Array, " n"]) -> Float[Array, " n"]:
    """How many steps of -1 amount to each value: about as many as there are to the goal."""
    if config.discount == 1:
        return -value
    left = jnp.maximum(1 + (1 - config.discount) * value, 1e-3)  # V can err below its limit
    return jnp.log(left) / jnp.log(config.discount)
