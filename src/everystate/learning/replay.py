"""Weighted replay (Appendix A): one ring of transitions under three weightings.

Every s' enters the state, the goal and the transition buffer of Algorithm 1 at the same moment,
so one ring holds the items and three vectors hold the weights, as logs: in float32 the linear
weights 1/p_f underflow.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from everystate.config import Config
from everystate.learning.keys import named


class Transitions(NamedTuple):
    """Transitions (s, a, s') in scaled units, with any leading axes."""

    observations: Float[Array, "*batch s"]
    actions: Float[Array, "*batch a"]
    next_observations: Float[Array, "*batch s"]


class Replay(NamedTuple):
    """The ring. Slots not yet filled have log-weight -inf."""

    transitions: Transitions
    state_log_weights: Float[Array, " capacity"]
    goal_log_weights: Float[Array, " capacity"]
    transition_log_weights: Float[Array, " capacity"]
    position: Int[Array, ""]
    size: Int[Array, ""]

    @property
    def capacity(self) -> int:
        """Number of slots."""
        return self.state_log_weights.shape[0]


def empty(capacity: int, state_size: int, action_size: int) -> Replay:
    """A ring without items."""
    nothing = jnp.full(capacity, -jnp.inf)
    states = jnp.zeros((capacity, state_size))
    transitions = Transitions(states, jnp.zeros((capacity, action_size)), jnp.zeros_like(states))
    zero = jnp.zeros((), jnp.int32)
    return Replay(transitions, nothing, nothing.copy(), nothing.copy(), zero, zero.copy())


def add(
    replay: Replay,
    transitions: Transitions,
    goal_log_weights: Float[Array, " n"],
    transition_log_weights: Float[Array, " n"],
) -> Replay:
    """Writes n transitions over the oldest, their s' with weight 1 as states (Algorithm 1)."""
    count = goal_log_weights.shape[0]
    slots = (replay.position + jnp.arange(count, dtype=jnp.int32)) % replay.capacity
    return Replay(
        jax.tree.map(lambda ring, new: ring.at[slots].set(new), replay.transitions, transitions),
        replay.state_log_weights.at[slots].set(0.0),
        replay.goal_log_weights.at[slots].set(goal_log_weights),
        replay.transition_log_weights.at[slots].set(transition_log_weights),
        (replay.position + count) % replay.capacity,
        jnp.minimum(replay.size + count, replay.capacity),
    )


def decay_states(replay: Replay, half_life: float) -> Replay:
    """Downweights all states by 0.5^(1/h), once per epoch (Algorithm 1)."""
    return replay._replace(state_log_weights=replay.state_log_weights - math.log(2) / half_life)


def median(log_weights: Float[Array, " capacity"]) -> Float[Array, ""]:
    """Median of the filled slots' log-weights."""
    filled = jnp.isfinite(log_weights)
    ordered = jnp.sort(jnp.where(filled, log_weights, jnp.inf))
    return ordered[jnp.maximum(filled.sum() - 1, 0) // 2]


def temper(
    config: Config, log_weights: Float[Array, " capacity"], centre: Float[Array, ""]
) -> Float[Array, " capacity"]:
    """Log-weights to the power `weight_temper`, held within `weight_clip` of `centre` [D1]."""
    tempered = config.weight_temper * (log_weights - centre)
    held = jnp.clip(tempered, -config.weight_clip, config.weight_clip)
    return jnp.where(jnp.isneginf(log_weights), -jnp.inf, held)


def draw(
    log_weights: Float[Array, " capacity"], count: int, *, key: PRNGKeyArray
) -> Int[Array, " count"]:
    """Slots drawn with replacement, with probability proportional to exp(log_weights).

    Two levels, blocks and then slots within a block, so that no prefix sum runs over the ring.
    """
    capacity = log_weights.shape[0]
    width = max(1, round(capacity**0.5))
    padded = jnp.pad(log_weights, (0, -capacity % width), constant_values=-jnp.inf)
    weights = jnp.exp(padded - jnp.max(padded)).reshape(-1, width)
    block_sums = weights.sum(axis=1)
    block_ends = jnp.cumsum(block_sums)
    points = jax.random.uniform(key, (count,)) * block_ends[-1]
    # Rounding must not carry a point past the end, nor past the last slot with any weight.
    blocks = jnp.searchsorted(block_ends, points, side="right")
    blocks = jnp.minimum(blocks, jnp.searchsorted(block_ends, block_ends[-1], side="left"))
    slot_ends = jnp.cumsum(weights[blocks], axis=1)
    rest = points - (block_ends[blocks] - block_sums[blocks])
    rest = jnp.clip(rest, 0.0, slot_ends[:, -1] * (1 - 1e-6))
    slots = (slot_ends <= rest[:, None]).sum(axis=1)
    return (blocks * width + slots).astype(jnp.int32)


def visited_goals(
    config: Config, replay: Replay, count: int, *, key: PRNGKeyArray
) -> Float[Array, "count s"]:
    """States drawn from the goal buffer: evenly over the space visited, not over the time spent."""
    weights = replay.goal_log_weights
    filled = jnp.isfinite(weights)
    # The mean will do for a centre here: a median at every control step would take too long.
    centre = jnp.where(filled, weights, 0.0).sum() / jnp.maximum(filled.sum(dtype=jnp.float32), 1.0)
    slots = draw(temper(config, weights, centre), count, key=key)
    return replay.transitions.next_observations[slots]


class Minibatch(NamedTuple):
    """mb_size draws from each of the three buffers, and where they lie."""

    states: Float[Array, "batch s"]
    goals: Float[Array, "batch s"]
    transitions: Transitions
    hindsight_goals: Float[Array, "batch s"]
    goal_slots: Int[Array, " batch"]
    transition_slots: Int[Array, " batch"]


def sample(
    config: Config, replay: Replay, centres: Float[Array, " 2"], *, key: PRNGKeyArray
) -> Minibatch:
    """One minibatch; `centres` are the medians of the goals' and transitions' log-weights."""
    goal_log_weights = temper(config, replay.goal_log_weights, centres[0])
    transition_log_weights = temper(config, replay.transition_log_weights, centres[1])
    states = draw(replay.state_log_weights, config.batch_size, key=named(key, "states"))
    goals = draw(goal_log_weights, config.batch_size, key=named(key, "goals"))
    slots = draw(transition_log_weights, config.batch_size, key=named(key, "transitions"))
    began, reached = replay.transitions.observations, replay.transitions.next_observations
    # num_bodies slots on is the same body one step later (2.3), unless it came to an end between.
    steps = jnp.arange(config.hindsight_steps, dtype=jnp.int32)
    chain = (slots[:, None] + steps[None, :] * config.num_bodies) % replay.capacity
    joined = (began[chain[:, 1:]] == reached[chain[:, :-1]]).all(axis=-1)
    unbroken = joined.cumprod(axis=1, dtype=jnp.int32).sum(axis=1)
    newer = (replay.position - 1 - slots) % replay.capacity // config.num_bodies
    ahead = jax.random.randint(
        named(key, "hindsight"), slots.shape, 0, config.hindsight_steps, jnp.int32
    )
    ahead = jnp.minimum(ahead, jnp.minimum(newer, unbroken))
    later = (slots + ahead * config.num_bodies) % replay.capacity
    if config.approach_share:
        led = jax.random.bernoulli(named(key, "led"), config.approach_share, goals.shape)
        states = jnp.where(led, approaching(config, replay, goals, key=named(key, "ago")), states)
    return Minibatch(
        states=reached[states],
        goals=reached[goals],
        transitions=jax.tree.map(lambda ring: ring[slots], replay.transitions),
        hindsight_goals=reached[later],
        goal_slots=goals,
        transition_slots=slots,
    )


def approaching(
    config: Config, replay: Replay, slots: Int[Array, " batch"], *, key: PRNGKeyArray
) -> Int[Array, " batch"]:
    """Slots of the same bodies up to `approach_steps` earlier; few steps are likelier than many.

    How many is log-uniform, 0 among them, but not beyond the oldest item or an end between.
    """
    began, reached = replay.transitions.observations, replay.transitions.next_observations
    chance = jax.random.uniform(key, slots.shape)
    wanted = jnp.exp(chance * math.log(config.approach_steps + 2)).astype(jnp.int32) - 1
    oldest = jnp.where(replay.size == replay.capacity, replay.position, 0)
    older = (slots - oldest) % replay.capacity // config.num_bodies
    steps = jnp.arange(config.approach_steps + 1, dtype=jnp.int32)
    chain = (slots[:, None] - steps[None, :] * config.num_bodies) % replay.capacity
    joined = (reached[chain[:, 1:]] == began[chain[:, :-1]]).all(axis=-1)
    unbroken = joined.cumprod(axis=1, dtype=jnp.int32).sum(axis=1)
    back = jnp.minimum(wanted, jnp.minimum(older, unbroken))
    return (slots - back * config.num_bodies) % replay.capacity


def refresh(
    replay: Replay,
    minibatch: Minibatch,
    goal_log_weights: Float[Array, " batch"],
    transition_log_weights: Float[Array, " batch"],
) -> Replay:
    """The ring with new weights for the goals and transitions just drawn (Algorithm 1)."""
    goals = replay.goal_log_weights.at[minibatch.goal_slots].set(goal_log_weights)
    transitions = replay.transition_log_weights.at[minibatch.transition_slots].set(
        transition_log_weights
    )
    return replay._replace(goal_log_weights=goals, transition_log_weights=transitions)


def effective_sample_size(log_weights: Float[Array, " capacity"]) -> Float[Array, ""]:
    """(sum w)^2 / sum w^2: how many equally weighted items the buffer is worth."""
    weights = jnp.exp(log_weights - jnp.max(log_weights))
    return weights.sum() ** 2 / (weights**2).sum()


def replay_metrics(
    config: Config, replay: Replay, centres: Float[Array, " 2"]
) -> dict[str, Float[Array, ""]]:
    """Size of the ring and effective sample sizes of the three buffers."""
    goals = temper(config, replay.goal_log_weights, centres[0])
    transitions = temper(config, replay.transition_log_weights, centres[1])
    return {
        "replay/size": replay.size.astype(jnp.float32),
        "replay/ess_states": effective_sample_size(replay.state_log_weights),
        "replay/ess_goals": effective_sample_size(goals),
        "replay/ess_transitions": effective_sample_size(transitions),
    }
