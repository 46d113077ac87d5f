"""The updates of an epoch one after the other, and what is kept of them."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from everystate.config import Config
from everystate.learning import guard
from everystate.learning.averages import averaged
from everystate.learning.keys import named
from everystate.learning.state import AgentState

Metrics = dict[str, Float[Array, "*updates"]]
UpdateOnce = Callable[[AgentState, PRNGKeyArray], tuple[AgentState, Metrics, guard.Batch]]


def repeated(
    config: Config, state: AgentState, update_once: UpdateOnce
) -> tuple[AgentState, Metrics, guard.Fault]:
    """n_updates updates, V copied to V_targ every `target_period` of them.

    Updates that are not finite change no model, nor do those after them if `config.not_finite` is
    "stop"; the first is handed out. Metrics are means over the others. Those taken enter the
    average of the weights, if there is one [D35].
    """
    copies, period = config.num_updates // config.target_period, config.target_period
    keys = jax.random.split(named(state.key, "update", state.epoch), (copies, period))
    numbers = jnp.arange(config.num_updates, dtype=jnp.int32).reshape(copies, period)
    arrays, static = eqx.partition(state, eqx.is_array)

    def one(
        carry: tuple[AgentState, guard.Fault], now: tuple[Int[Array, ""], PRNGKeyArray]
    ) -> tuple[tuple[AgentState, guard.Fault], tuple[Metrics, Bool[Array, ""]]]:
        (arrays, fault), (number, key) = carry, now
        state = eqx.combine(arrays, static)
        after, metrics, batch = update_once(state, key)
        fine = guard.finite(metrics)
        fault = guard.first(fault, number, batch, fine)
        taken = fine if config.not_finite == "roll-back" else fault.update < 0
        if state.average is not None:
            count = state.epoch * config.num_updates + number
            average = averaged(config, state.average, after.models, count)
            after = after._replace(average=guard.chosen(taken, average, state.average))
        after = after._replace(
            models=guard.chosen(taken, after.models, state.models),
            optimisers=guard.chosen(taken, after.optimisers, state.optimisers),
        )
        return (eqx.filter(after, eqx.is_array), fault), (metrics, taken)

    def until_next_copy(
        carry: tuple[AgentState, guard.Fault], now: tuple[Int[Array, " n"], Key[Array, " n"]]
    ) -> tuple[tuple[AgentState, guard.Fault], tuple[Metrics, Bool[Array, " n"]]]:
        arrays, fault = carry
        arrays = arrays._replace(target_values=arrays.models.values, copies=arrays.copies + 1)
        return jax.lax.scan(one, (arrays, fault), now)

    begun = arrays, guard.no_fault(config, state.replay.transitions)
    (arrays, fault), (every, taken) = jax.lax.scan(until_next_copy, begun, (numbers, keys))
    metrics = {name: values.mean(where=taken) for name, values in every.items()}
    fault = fault._replace(metrics={n: x.reshape(-1)[fault.update] for n, x in every.items()})
    metrics["update/taken"] = taken.mean(dtype=jnp.float32)
    return eqx.combine(arrays, static), metrics, fault
