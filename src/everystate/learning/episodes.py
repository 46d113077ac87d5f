"""When an episode ends: the rule of Algorithm 1 for many bodies at once, never with a reset."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from everystate.hyperparameters import Collection

WANDER = -1
"""In the place of an objective: acting at random."""
WANDERED = 5
"""Random actions in such an episode, each kept for `wander_steps`."""
REACHED = 0.25
"""A training goal counts as reached within this largest distance over scaled components."""


class Episodes(NamedTuple):
    """What each body is up to, and a tally of the episodes that ended in this epoch."""

    goals: Float[Array, "bodies s"]  # Scaled.
    objectives: Int[Array, " bodies"]  # By which of the run's; or WANDER.
    best_values: Float[Array, " bodies"]
    steps_since_best: Int[Array, " bodies"]
    lengths: Int[Array, " bodies"]
    nearest: Float[Array, " bodies"]  # Least distance to the goal so far, scaled.
    tally: Float[Array, " 3"]  # Ended episodes: how many, how many reached, summed lengths.


def no_episodes(config: Collection, state_size: int) -> Episodes:
    """Bodies without a goal: each takes one at its first step."""
    bodies = config.num_bodies
    return Episodes(
        goals=jnp.zeros((bodies, state_size)),
        objectives=jnp.zeros(bodies, jnp.int32),
        best_values=jnp.full(bodies, jnp.inf),  # No value is better: over at once.
        steps_since_best=jnp.full(bodies, config.patience, jnp.int32),
        lengths=jnp.zeros(bodies, jnp.int32),
        nearest=jnp.full(bodies, jnp.inf),
        tally=jnp.zeros(3),
    )


def parts(episodes: Episodes, count: int) -> list[Episodes]:
    """Those of `count` equal groups of bodies, in order, each with a tally of its own."""
    leaves = [jnp.split(x, count) for x in episodes[:-1]]
    return [Episodes._make([*of_group, jnp.zeros(3)]) for of_group in zip(*leaves, strict=True)]


def joined(parts: Sequence[Episodes]) -> Episodes:
    """The inverse of `parts`; the tallies are added up."""
    *leaves, tallies = zip(*parts, strict=True)
    return Episodes._make([*map(jnp.concatenate, leaves), jnp.stack(tallies).sum(axis=0)])


def advance(
    config: Collection,
    episodes: Episodes,
    states: Float[Array, "bodies s"],
    values: Float[Array, " bodies"],
) -> tuple[Episodes, Bool[Array, " bodies"]]:
    """Accounts for the states just reached and says whose episode is over.

    The paper goes on while V(s, g) does not fall; here, while V has risen to a new best within
    the last `patience` steps, which is the same at patience 1 [D2]. A cap ends it anyway. Bodies
    that wander do so for as long as they are meant to [D22], and enter no tally.
    """
    improved = values >= episodes.best_values
    since_best = jnp.where(improved, 0, episodes.steps_since_best + 1)
    over = (since_best >= config.patience) | (episodes.lengths >= config.max_episode_steps)
    wanders = episodes.objectives == WANDER
    over = jnp.where(wanders, episodes.lengths >= WANDERED * config.wander_steps, over)
    distance = jnp.abs(states - episodes.goals).max(axis=1)
    nearest = jnp.minimum(episodes.nearest, distance)
    ended = over & (episodes.lengths > 0) & ~wanders
    counts = [ended.sum(), (ended & (nearest <= REACHED)).sum()]
    counts.append(jnp.where(ended, episodes.lengths, 0).sum())
    tally = episodes.tally + jnp.stack(counts).astype(jnp.float32)
    return episodes._replace(
        best_values=jnp.maximum(values, episodes.best_values),
        steps_since_best=since_best,
        lengths=episodes.lengths + 1,
        nearest=nearest,
        tally=tally,
    ), over


def restart(
    episodes: Episodes,
    over: Bool[Array, " bodies"],
    goals: Float[Array, "bodies s"],
    objectives: Int[Array, " bodies"],
    values: Float[Array, " bodies"],
) -> Episodes:
    """Gives the bodies whose episode is over new goals and objectives, whose V is `values`."""
    return episodes._replace(
        goals=jnp.where(over[:, None], goals, episodes.goals),
        objectives=jnp.where(over, objectives, episodes.objectives),
        best_values=jnp.where(over, values, episodes.best_values),
        steps_since_best=jnp.where(over, 0, episodes.steps_since_best),
        lengths=jnp.where(over, 1, episodes.lengths),
        nearest=jnp.where(over, jnp.inf, episodes.nearest),
    )


def episode_metrics(episodes: Episodes) -> dict[str, Float[Array, ""]]:
    """Means over the episodes that ended since the tally was last cleared."""
    ended, reached, length = episodes.tally
    count = jnp.maximum(ended, 1)
    return {
        "episode/ended": ended,
        "episode/reached": reached / count,
        "episode/length": length / count,
    }


def without_tally(episodes: Episodes) -> Episodes:
    """With the tally cleared."""
    return episodes._replace(tally=jnp.zeros(3))
