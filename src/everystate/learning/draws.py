"""What chance decides about an epoch of collection, before any body moves."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from everystate.config import Config
from everystate.learning.episodes import WANDER
from everystate.learning.goals import choose_goals
from everystate.learning.keys import named
from everystate.learning.objectives import objectives
from everystate.learning.state import AgentState


class Draws(NamedTuple):
    """What chance decides about a step of some bodies, apart from their own noise."""

    goals: Float[Array, "*steps bodies s"]
    """Scaled; for those whose episode is over."""
    latents: Float[Array, "*steps bodies a"]
    """z of the actions a = pi_dec(z)."""
    objectives: Int[Array, "*steps bodies"]
    """By which of the run's, or WANDER, for those whose episode is over."""
    anywhere: Float[Array, "*steps bodies a"] | None = None
    """How bodies act that wander [D22]; None: nobody ever does."""


def draw(config: Config, state: AgentState) -> Draws:
    """All of an epoch: neither f nor replay changes in it.

    Leaves are [steps, bodies, ...]; what is drawn for a body is so however bodies are grouped.
    """
    steps = jnp.arange(config.steps_per_epoch, dtype=jnp.int32)
    # One step after the other: all at once would hold m candidates for every goal of the epoch.
    return jax.lax.map(
        lambda step: _of_step(config, state, step), state.epoch * config.steps_per_epoch + steps
    )


def _of_step(config: Config, state: AgentState, step: Int[Array, ""]) -> Draws:
    action_size = state.replay.transitions.actions.shape[-1]
    key = named(state.key, "act", step)
    keys = jax.random.split(named(key, "actions"), config.num_bodies)
    count, bodies = len(objectives(config)), (config.num_bodies,)
    draws = Draws(
        goals=choose_goals(config, state.models, state.replay, key=named(key, "goals")),
        latents=jax.vmap(lambda key: jax.random.normal(key, (action_size,)))(keys),
        objectives=jax.random.randint(named(key, "objectives"), bodies, 0, count, jnp.int32),
    )
    if config.central_share:
        of_epoch = named(state.key, "central", step // config.steps_per_epoch)
        central = jax.random.bernoulli(of_epoch, config.central_share, (config.num_bodies, 1))
        draws = draws._replace(latents=jnp.where(central, 0.0, draws.latents))
    if not config.wander_share:
        return draws
    wanders = jax.random.bernoulli(named(key, "wander"), config.wander_share, bodies)
    kept = named(state.key, "wandering", step // config.wander_steps)
    return draws._replace(
        objectives=jnp.where(wanders, WANDER, draws.objectives),
        anywhere=jax.random.uniform(kept, draws.latents.shape, minval=-1, maxval=1),
    )
