"""What an agent computes, on scaled states.

Compiled once per shape of batch, for all agents of the same architecture.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key, PRNGKeyArray

from everystate.config import Config
from everystate.features import Part
from everystate.learning.completion import Atlas, new_atlas
from everystate.learning.completion import completed as complete
from everystate.learning.goals import imagined, least_likely
from everystate.learning.models import Models, Scale
from everystate.learning.objectives import objectives, pursued, worths
from everystate.learning.planning import Planned, Planning
from everystate.learning.planning import plan as search
from everystate.learning.policy import central

_BATCH = 64  # of searches, whose imagined outcomes must fit into memory


@eqx.filter_jit
def act(
    config: Config, models: Models, states: Float[Array, "n s"], goals: Float[Array, "n s"]
) -> Float[Array, "n a"]:
    """The most central actions (z = 0) of the policies by which the goals are pursued."""
    return jax.vmap(lambda state, goal: central(config, models, state, goal))(states, goals)


@eqx.filter_jit
def sample(
    config: Config,
    models: Models,
    states: Float[Array, "n s"],
    goals: Float[Array, "n s"],
    key: PRNGKeyArray,
) -> Float[Array, "n a"]:
    """Actions drawn from the policies by which the goals are pursued."""

    def drawn(
        state: Float[Array, " s"], goal: Float[Array, " s"], key: PRNGKeyArray
    ) -> Float[Array, " a"]:
        latent = jax.random.normal(key, models.policies[0](state, goal).shape)
        every = jnp.stack([policy.at(state, goal, latent) for policy in models.policies])
        return jnp.clip(every[pursued(config, models, state, goal)], -1, 1)

    return jax.vmap(drawn)(states, goals, jax.random.split(key, len(states)))


@eqx.filter_jit
def plan(
    config: Config,
    planning: Planning,
    models: Models,
    states: Float[Array, "n s"],
    goals: Float[Array, "n s"],
    key: PRNGKeyArray,
) -> Planned:
    """What a search decides for each, its gain in control steps."""
    found = jax.lax.map(
        lambda x: search(config, planning, models, x[0], x[1], key=x[2]),
        (states, goals, jax.random.split(key, len(states))),
        batch_size=_even(len(states)),
    )
    return found._replace(gain=found.gain * config.interval)


@eqx.filter_jit
def ahead(
    models: Models, states: Float[Array, "n s"], actions: Float[Array, "n horizon a"]
) -> Float[Array, "n horizon+1 s"]:
    """Where the dynamics, without noise, say that actions lead, from the states on."""

    def one(s: Float[Array, "n s"], action: Float[Array, "n a"]) -> tuple[Array, Array]:
        after = jax.vmap(models.dynamics.central)(s, action)
        return after, after

    way = jax.lax.scan(one, states, jnp.moveaxis(actions, 1, 0))[1]
    return jnp.moveaxis(jnp.concatenate([states[None], way]), 0, 1)


def _even(count: int) -> int:
    """A size for batches that seldom leaves a smaller rest, which would be compiled too."""
    return -(-count // max(1, -(-count // _BATCH))) or 1


@eqx.filter_jit
def propose(m: int, models: Models, keys: Key[Array, " n"]) -> Float[Array, "n s"]:
    """For each key the least likely of m imagined states."""
    flow = models.state_flow
    return jax.vmap(lambda key: least_likely(flow, imagined(flow, m, key=key)))(keys)


@eqx.filter_jit
def atlas(
    config: Config, models: Models, scale: Scale, states: Float[Array, "n s"] | None
) -> Atlas:
    """States that the body can be in."""
    return new_atlas(config, models, scale, states)


@eqx.filter_jit
def completed(
    config: Config,
    models: Models,
    scale: Scale,
    parts: tuple[Part, ...],
    atlas: Atlas,
    states: Float[Array, "n s"],
    components: Float[Array, "n s"],
    features: dict[str, Float[Array, " n"]],
) -> Float[Array, "n s"]:
    """Whole goals for what is asked, all in the units of the body."""
    return jax.lax.map(
        lambda x: complete(config, models, scale, parts, atlas, *x),
        (states, components, features),
        batch_size=_even(len(states)),
    )


@eqx.filter_jit
def values(
    config: Config, models: Models, states: Float[Array, "n s"], goals: Float[Array, "n s"]
) -> Float[Array, " n"]:
    """V, in control steps, of the objectives by which the goals are pursued."""

    def value(state: Float[Array, " s"], goal: Float[Array, " s"]) -> Float[Array, ""]:
        every = worths(config, models.values, state, goal)
        return every[pursued(config, models, state, goal)] * config.interval

    return jax.vmap(value)(states, goals)


@eqx.filter_jit
def steps(
    config: Config, models: Models, states: Float[Array, "n s"], goals: Float[Array, "n s"]
) -> Float[Array, " n"]:
    """Control steps to the goals, by the V that knows them best: of passing, if there is one."""
    *_, (aim, V) = zip(objectives(config), models.values, strict=False)
    return aim.steps(jax.vmap(aim.read)(jax.vmap(V)(states, goals))) * config.interval


@eqx.filter_jit
def log_density(models: Models, states: Float[Array, "n s"]) -> Float[Array, " n"]:
    """log p_f of scaled states."""
    return models.state_flow.log_prob(states)
