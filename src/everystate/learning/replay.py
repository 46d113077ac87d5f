"""Weighted replay (Appendix A): one ring of transitions under three weightings.

Every s' enters the state, the goal and the transition buffer of Algorithm 1 at the same moment,
so one ring holds the items and three sets of weights go with it.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from everystate.config import Config
from everystate.learning import weights as w
from everystate.learning.keys import named
from everystate.learning.weights import AS_THEY_ARE, Weights, tempering


class Transitions(NamedTuple):
    """Transitions (s, a, s') of bodies on their way to g, scaled, with any leading axes."""

    observations: Float[Array, "*batch s"]
    actions: Float[Array, "*batch a"]
    next_observations: Float[Array, "*batch s"]
    goals: Float[Array, "*batch g"]
    """Of size 0 in a ring that keeps none, as nothing is learned of them [D24]."""


class Replay(NamedTuple):
    """The ring, and the weights of its items as states, as goals and as transitions."""

    transitions: Transitions
    states: Weights
    goals: Weights
    of_transitions: Weights
    position: Int[Array, ""]
    size: Int[Array, ""]

    @property
    def capacity(self) -> int:
        """Number of slots."""
        return self.transitions.actions.shape[0]


def empty(config: Config, state_size: int, action_size: int) -> Replay:
    """A ring without items."""
    capacity, kept = config.capacity, state_size if config.pursued_share else 0
    sizes = state_size, action_size, state_size, kept
    transitions = Transitions(*(jnp.zeros((capacity, size)) for size in sizes))
    zero = jnp.zeros((), jnp.int32)
    return Replay(
        transitions,
        w.no_weights(capacity),
        w.no_weights(capacity),
        w.no_weights(capacity),
        zero,
        zero.copy(),
    )


def add(
    config: Config,
    replay: Replay,
    transitions: Transitions,
    goal_log_weights: Float[Array, " n"],
    transition_log_weights: Float[Array, " n"],
) -> Replay:
    """Writes n transitions over the oldest, their s' with weight 1 as states (Algorithm 1).

    Log-weights that are not finite become the buffer's centre.
    """
    count, how = goal_log_weights.shape[0], tempering(config)
    goal_log_weights, transition_log_weights = (
        jnp.where(jnp.isfinite(log), log, weights.centre)
        for log, weights in (
            (goal_log_weights, replay.goals),
            (transition_log_weights, replay.of_transitions),
        )
    )
    slots = (replay.position + jnp.arange(count, dtype=jnp.int32)) % replay.capacity
    return Replay(
        jax.tree.map(lambda ring, new: ring.at[slots].set(new), replay.transitions, transitions),
        w.weigh(replay.states.log.at[slots].set(0.0), AS_THEY_ARE),
        w.weigh(replay.goals.log.at[slots].set(goal_log_weights), how),
        w.weigh(replay.of_transitions.log.at[slots].set(transition_log_weights), how),
        (replay.position + count) % replay.capacity,
        jnp.minimum(replay.size + count, replay.capacity),
    )


def decay_states(replay: Replay, half_life: float) -> Replay:
    """Downweights all states by 0.5^(1/h), once per epoch (Algorithm 1)."""
    log, reference = (
        x - math.log(2) / half_life for x in (replay.states.log, replay.states.reference)
    )
    return replay._replace(states=replay.states._replace(log=log, reference=reference))


def visited_goals(
    config: Config, replay: Replay, count: int, *, key: PRNGKeyArray
) -> Float[Array, "count s"]:
    """States drawn from the goal buffer: evenly over the space visited, not over the time spent."""
    slots = w.draw(replay.goals, tempering(config), count, key=key)
    return replay.transitions.next_observations[slots]


def any_visited(replay: Replay, count: int, *, key: PRNGKeyArray) -> Float[Array, "count s"]:
    """States visited, each step as likely as any other."""
    slots = jax.random.randint(key, (count,), 0, replay.size, jnp.int32)
    return replay.transitions.next_observations[slots]


def drawn_transitions(
    config: Config, replay: Replay, count: int, *, key: PRNGKeyArray
) -> Transitions:
    """Transitions from their buffer, without anything else."""
    slots = w.draw(replay.of_transitions, tempering(config), count, key=key)
    return jax.tree.map(lambda ring: ring[slots], replay.transitions)


class Minibatch(NamedTuple):
    """mb_size draws from each of the three buffers, and where they lie."""

    states: Float[Array, "batch s"]
    goals: Float[Array, "batch s"]
    transitions: Transitions
    goal_slots: Int[Array, " batch"]
    transition_slots: Int[Array, " batch"]


_CALMEST_OF = 16


def goal_slots(
    config: Config,
    replay: Replay,
    unit: Float[Array, " s"],
    count: int,
    *,
    key: PRNGKeyArray,
) -> Int[Array, " count"]:
    """Slots drawn from the goal buffer, `calm_share` of them such as hardly changed in a step.

    Of several drawn for each of these, the one whose s' - s is the least, in units of
    `unit`: without them equilibria, which are what is asked for most and what is hardest to
    hold, are hardly ever drawn [D32].
    """
    how = tempering(config)
    slots = w.draw(replay.goals, how, count, key=named(key, "goals"))
    if not config.calm_share:
        return slots
    several = w.draw(replay.goals, how, count * _CALMEST_OF, key=named(key, "calm"))
    t = replay.transitions
    change = (t.next_observations[several] - t.observations[several]) / unit[None]
    speed = jnp.mean(change**2, axis=1).reshape(count, _CALMEST_OF)
    calmest = several.reshape(count, _CALMEST_OF)[
        jnp.arange(count, dtype=jnp.int32), speed.argmin(axis=1)
    ]
    calm = jax.random.bernoulli(named(key, "whether calm"), config.calm_share, (count,))
    return jnp.where(calm, calmest, slots)


def sample(
    config: Config, replay: Replay, unit: Float[Array, " s"], *, key: PRNGKeyArray
) -> Minibatch:
    """One minibatch from the three buffers; `unit` as in `goal_slots`."""
    size, how = config.batch_size, tempering(config)
    states = w.draw(replay.states, AS_THEY_ARE, size, key=named(key, "states"))
    goals = goal_slots(config, replay, unit, size, key=key)
    slots = w.draw(replay.of_transitions, how, size, key=named(key, "transitions"))
    reached = replay.transitions.next_observations
    if config.approach_share:
        led = jax.random.bernoulli(named(key, "led"), config.approach_share, goals.shape)
        states = jnp.where(led, approaching(config, replay, goals, key=named(key, "ago")), states)
    return Minibatch(
        states=reached[states],
        goals=reached[goals],
        transitions=jax.tree.map(lambda ring: ring[slots], replay.transitions),
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
    config: Config,
    replay: Replay,
    minibatch: Minibatch,
    goal_log_weights: Float[Array, " batch"],
    transition_log_weights: Float[Array, " batch"],
) -> Replay:
    """The ring with new weights for the goals and transitions just drawn (Algorithm 1)."""
    how = tempering(config)
    return replay._replace(
        goals=w.refresh(replay.goals, how, minibatch.goal_slots, goal_log_weights),
        of_transitions=w.refresh(
            replay.of_transitions, how, minibatch.transition_slots, transition_log_weights
        ),
    )


def replay_metrics(config: Config, replay: Replay) -> dict[str, Float[Array, ""]]:
    """Size of the ring and effective sample sizes of the three buffers."""
    how = tempering(config)
    return {
        "replay/size": replay.size.astype(jnp.float32),
        "replay/ess_states": w.effective_sample_size(replay.states.log),
        "replay/ess_goals": w.effective_sample_size(w.tempered(replay.goals, how)),
        "replay/ess_transitions": w.effective_sample_size(w.tempered(replay.of_transitions, how)),
    }
