"""Targets of the value (4.3, eq. 2), and the steps that a value stands for."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from everystate.config import Config


def backup(
    config: Config, near: Float[Array, ""], value: Float[Array, ""], floor: Float[Array, ""]
) -> Float[Array, ""]:
    """r + V_targ(s', g) with r = -1 + near (eq. 2).

    `bound_value` holds V_targ within [floor, 0], the values it can truly have [D4]. It does so
    here rather than in the network: an output through softplus, once at 0, stayed there.

    With `absorb`, V_targ counts only for the share of s' that has not reached g, or gone on from
    it: eq. 2's V(s, s) = 0 in proportion to a power of the reward's partial credit [D10].
    `discount` [D18].
    """
    return near - 1 + remaining(config, near) * bounded(config, value, floor)


def remaining(config: Config, near: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The share of what comes after s' that counts."""
    return config.discount * (1 - config.absorb * near**config.absorb_power)


def bounded(
    config: Config, value: Float[Array, "*n"], floor: Float[Array, ""]
) -> Float[Array, "*n"]:
    """V_targ within what it can truly be."""
    return jnp.clip(value, floor, 0) if config.bound_value else value


def lowest(config: Config, copies: Int[Array, ""]) -> Float[Array, ""]:
    """The least that V_targ can truly be after so many copies: -1 at each of as many steps [D4]."""
    count = copies.astype(jnp.float32)
    if config.discount == 1:
        return -count
    return (config.discount**count - 1) / (1 - config.discount)


def steps(config: Config, value: Float[Array, " n"]) -> Float[Array, " n"]:
    """How many steps of -1 amount to each value: about as many as there are to the goal."""
    if config.discount == 1:
        return -value
    left = jnp.maximum(1 + (1 - config.discount) * value, 1e-3)  # V can err below its limit
    return jnp.log(left) / jnp.log(config.discount)
