"""Goal generation for exploration (4.1)."""

import math

import jax
import jax.numpy as jnp
from flowjax.distributions import AbstractTransformed
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.learning.flows import decode


def imagined(state_flow: AbstractTransformed, m: int, *, key: PRNGKeyArray) -> Float[Array, "m s"]:
    """m decoded samples g_i = f_dec(z_i) (4.1)."""
    latents = jax.random.normal(key, (m, *state_flow.shape))
    return jax.vmap(lambda z: decode(state_flow, z))(latents)


def uniform(count: int, state_size: int, *, key: PRNGKeyArray) -> Float[Array, "count s"]:
    """Scaled states from a box around all of them, of unit variance: what an oracle would know."""
    limit = math.sqrt(3)
    return jax.random.uniform(key, (count, state_size), minval=-limit, maxval=limit)


def least_likely(state_flow: AbstractTransformed, goals: Float[Array, "m s"]) -> Float[Array, " s"]:
    """argmin over the goals of p_f(g_i) (4.1, Algorithm 1)."""
    return goals[jnp.argmin(state_flow.log_prob(goals))]
