"""The pairs (s, g) that an update learns from: how Algorithm 1 changes those drawn."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning.components import asked
from everystate.learning.curriculum import replaced
from everystate.learning.flows import decode
from everystate.learning.keys import named
from everystate.learning.models import Models
from everystate.learning.replay import Minibatch


class Pairs(NamedTuple):
    """Where to start from and where to go."""

    starts: Float[Array, "batch s"]
    goals: Float[Array, "batch s"]
    rarity: tuple[Float[Array, " batch"], ...]
    """-log p_f of the goals drawn, and of both ends of the transitions."""
    proposed: Float[Array, ""]
    """Share of the starts that the curriculum proposed."""


def paired(config: Config, models: Models, minibatch: Minibatch, *, key: PRNGKeyArray) -> Pairs:
    """s_c ~ c(s|g) takes the place of s where f makes that likely enough (Algorithm 1).

    And some pairs are a body's own, on its way to a goal [D24]. No goal asks for what no action
    changes [D39].
    """
    states, goals, t = minibatch.states, minibatch.goals, minibatch.transitions
    latents = jax.random.normal(named(key, "c"), states.shape)
    proposed = jax.vmap(lambda g, z: decode(models.curriculum(g), z))(goals, latents)
    scored = jnp.stack([states, proposed, goals, t.observations, t.next_observations])
    lp_state, lp_proposed, *drawn = models.state_flow.log_prob(scored)
    use = replaced(config, lp_proposed, lp_state, key=named(key, "replace"))
    starts = jnp.where(use[:, None], proposed, states)
    if config.pursued_share:
        chance = config.pursued_share, (config.batch_size, 1)
        pursued = jax.random.bernoulli(named(key, "pursued"), *chance)
        starts = jnp.where(pursued, t.observations, starts)
        goals = jnp.where(pursued, t.goals, goals)
    goals = asked(models.dynamics.weights, starts, goals)
    rarity = tuple(-log_prob for log_prob in drawn)
    return Pairs(starts, goals, rarity, use.mean(dtype=jnp.float32))
