"""Goal generation for exploration (4.1)."""

import jax
import jax.numpy as jnp
from flowjax.distributions import AbstractTransformed
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.learning.flows import decode


def least_likely_goal(
    state_flow: AbstractTransformed, m: int, *, key: PRNGKeyArray
) -> Float[Array, " s"]:
    """argmin over m decoded samples g_i = f_dec(z_i) of p_f(g_i) (4.1, Algorithm 1)."""
    latents = jax.random.normal(key, (m, *state_flow.shape))
    goals = jax.vmap(lambda z: decode(state_flow, z))(latents)
    return goals[jnp.argmin(state_flow.log_prob(goals))]
