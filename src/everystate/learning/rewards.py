"""The shaped reward (4.2)."""

import jax.numpy as jnp
from flowjax.distributions import AbstractTransformed
from jaxtyping import Array, Float

from everystate.config import Config
from everystate.learning.flows import encode


def place(
    config: Config, state_flow: AbstractTransformed, state: Float[Array, " s"]
) -> Float[Array, " s"]:
    """Where the reward sees a scaled state: its latent f_enc(s), or the state itself [D9]."""
    return encode(state_flow, state) if config.reward_space == "latent" else state


def closeness(
    config: Config, place_next: Float[Array, " s"], place_goal: Float[Array, " s"]
) -> Float[Array, ""]:
    """exp(-k |f_enc(s') - f_enc(g)|^2), in [0, 1]; the reward is this minus one (4.2).

    In many dimensions that is 0 practically everywhere; the rational shape is not [D21].
    """
    square = config.k * jnp.sum((place_next - place_goal) ** 2)
    return 1 / (1 + square) if config.reward_shape == "rational" else jnp.exp(-square)
