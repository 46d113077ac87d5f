"""Goal generation for exploration (4.1)."""

import math

import jax
import jax.numpy as jnp
from flowjax.distributions import AbstractTransformed
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning import replay as rb
from everystate.learning.components import unit
from everystate.learning.flows import decode
from everystate.learning.keys import named
from everystate.learning.models import Models


def choose_goals(
    config: Config, models: Models, replay: rb.Replay, *, key: PRNGKeyArray
) -> Float[Array, "bodies s"]:
    """For every body, the least likely under f of m goals from where the config says (4.1).

    Or, for `1 - rare_share` of them, any state visited, or one that was passed slowly [D32].
    """
    flow, count = models.state_flow, config.num_bodies * config.m
    if config.goals == "imagined":
        goals = imagined(flow, count, key=key)
    elif config.goals == "visited":
        goals = rb.visited_goals(config, replay, count, key=key)
    elif config.goals == "uniform":
        goals = uniform(count, flow.shape[0], key=key)
    else:
        goals = rb.any_visited(replay, count, key=key)
    goals = goals.reshape(config.num_bodies, config.m, -1)
    rarest = jax.vmap(lambda g: least_likely(flow, g))(goals)
    if config.rare_share == 1:
        return rarest
    others = rb.goal_slots(
        config, replay, unit(models.dynamics), config.num_bodies, key=named(key, "others")
    )
    rare = jax.random.bernoulli(named(key, "rare"), config.rare_share, (config.num_bodies, 1))
    return jnp.where(rare, rarest, replay.transitions.next_observations[others])


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
