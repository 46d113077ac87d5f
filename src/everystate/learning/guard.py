"""A step that would leave a model not finite is not taken, and what led to it is kept."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from everystate.config import Config
from everystate.learning.objectives import objectives
from everystate.learning.replay import Minibatch, Transitions


class Batch(NamedTuple):
    """What the losses of one update were computed from, in scaled units."""

    minibatch: Minibatch
    starts: Float[Array, "batch s"]
    """s_i, some replaced by the curriculum."""
    best_actions: Float[Array, "improved a"]
    """a_best for the first (s_i, g_i), or for all; one objective after the other."""
    targets: Float[Array, " improved"]
    """v_targ for these."""


class Fault(NamedTuple):
    """The first update of an epoch with a loss or a gradient that is not finite."""

    update: Int[Array, ""]
    """Its number within the epoch, from 0; -1 where there is none."""
    batch: Batch
    metrics: dict[str, Float[Array, ""]]
    """Of that update; filled in at the end of the epoch."""


def no_fault(config: Config, transitions: Transitions) -> Fault:
    """Before an epoch."""

    def row(like: Array) -> Float[Array, "batch n"]:
        return jnp.zeros((config.batch_size, like.shape[-1]))

    def states() -> Float[Array, "batch s"]:
        return row(transitions.observations)

    slots = jnp.zeros(config.batch_size, jnp.int32)
    drawn = Transitions(*map(row, transitions))
    minibatch = Minibatch(states(), states(), drawn, slots, slots)
    improved = config.improved_pairs * len(objectives(config))
    actions = jnp.zeros((improved, transitions.actions.shape[-1]))
    batch = Batch(minibatch, states(), actions, jnp.zeros(improved))
    return Fault(jnp.full((), -1, jnp.int32), batch, {})


def finite(metrics: dict[str, Float[Array, ""]]) -> Bool[Array, ""]:
    """Whether an update's losses, gradient norms and targets all are."""
    return jnp.isfinite(jnp.stack(list(metrics.values()))).all()


def first(fault: Fault, number: Int[Array, ""], batch: Batch, fine: Bool[Array, ""]) -> Fault:
    """The fault so far, or the one of update `number` if that is not fine and the first."""
    return chosen(fine | (fault.update >= 0), fault, Fault(number, batch, {}))


def chosen(condition: Bool[Array, ""], one: Any, other: Any) -> Any:
    """One of two trees of the same shapes; what is no array is taken from the first."""

    def leaf(a: Any, b: Any) -> Any:
        return jnp.where(condition, a, b) if eqx.is_array(a) else a

    return jax.tree.map(leaf, one, other)
