"""The algorithm's functions, compiled once for a run."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
from jaxtyping import Array, Float

from everystate import algorithm
from everystate.agent import own
from everystate.algorithm import AgentState, Scale
from everystate.config import Config
from everystate.learning.episodes import Episodes
from everystate.learning.guard import Fault
from everystate.learning.keys import named
from everystate.learning.replay import Transitions
from everystate.learning.sharding import whole
from everystate.training import hosts
from everystate.training.programs import kept


class Learner(NamedTuple):
    """`act`, `observe` and `update` of the algorithm, for one config.

    Over several devices, `act` is this host's own affair and gives a state that only `observe`
    takes; all hosts must call the other two alike, where the first one's steps and episodes count.
    """

    act: Callable[[AgentState, Float[Array, "bodies s"]], tuple[AgentState, Array]]
    observe: Callable[[AgentState, Transitions], AgentState]
    update: Callable[[AgentState], tuple[AgentState, dict[str, Float[Array, ""]], Fault]]
    """Its argument is used up: the new state takes over its memory."""


def jit(function: Callable) -> Any:
    """Compiled as the algorithm's functions are."""
    options: dict[str, Any] = {"compiler_options": _compiler_options()}
    return eqx.filter_jit(function, **options)


@functools.lru_cache(maxsize=4)
def compiled(config: Config) -> Learner:
    """Compiles on first use; never again, because states keep their shapes and dtypes."""

    def changed_by_act(
        state: AgentState, observations: Float[Array, "bodies s"]
    ) -> tuple[Episodes, Array, Array]:
        after, actions = algorithm.act(config, state, observations)
        return after.episodes, after.step, actions

    def observed(state: AgentState, steps: Transitions) -> list[Array]:
        return _arrays(algorithm.observe(config, state, steps))

    def updated(state: AgentState) -> tuple[list[Array], dict[str, Array], Fault]:
        state, metrics, fault = algorithm.update(config, state)
        return _arrays(state), metrics, fault

    everywhere = {} if config.devices == 1 else {"out_shardings": whole(config)}
    acting = _of_arrays("act", config, changed_by_act)
    observing = _of_arrays("observe", config, observed, **everywhere)
    updating = _of_arrays("update", config, updated, donate_argnums=0, **everywhere)

    def act(
        state: AgentState, observations: Float[Array, "bodies s"]
    ) -> tuple[AgentState, Float[Array, "bodies a"]]:
        # The rest stays outside: what goes through a program is copied, all of replay at each step.
        # And to the first device: the others would only do the same.
        held = state if config.devices == 1 else hosts.local(state)
        episodes, step, actions = acting(held, observations)
        return state._replace(episodes=episodes, step=step), actions

    def observe(state: AgentState, steps: Transitions) -> AgentState:
        changed = hosts.shared(config, (state.episodes, state.step, steps))
        state, steps = state._replace(episodes=changed[0], step=changed[1]), changed[2]
        return _structure(state)(observing(state, steps))

    def update(state: AgentState) -> tuple[AgentState, dict[str, Array], Fault]:
        arrays, metrics, fault = updating(state)
        return _structure(state)(arrays), metrics, fault

    return Learner(act, observe, update)


def _of_arrays(name: str, config: Config, function: Callable, **options: Any) -> Callable:
    """A function of a state, compiled as one of its arrays; what else it has is always the same."""
    made: dict[str, Callable] = {}

    def call(state: AgentState, *more: Any) -> Any:
        arguments = (_arrays(state), *more)
        if name not in made:
            put_in = _structure(state)  # and not the state, whose arrays would stay in memory

            def of_arrays(arrays: list[Array], *more: Any) -> Any:
                return function(put_in(arrays), *more)

            options["compiler_options"] = _compiler_options()
            made[name] = kept(name, config, of_arrays, arguments, **options)
        return made[name](*arguments)

    return call


def _arrays(state: AgentState) -> list[Array]:
    return jax.tree.leaves(eqx.filter(state, eqx.is_array))


def _structure(state: AgentState) -> Callable[[list[Array]], AgentState]:
    """Puts arrays in the place of a state's own."""
    dynamic, static = eqx.partition(state, eqx.is_array)
    structure = jax.tree.structure(dynamic)
    return lambda arrays: eqx.combine(jax.tree.unflatten(structure, arrays), static)


def _compiler_options() -> dict[str, str]:
    # XLA's own loops over few elements are quicker than the YNNPACK calls it would make of them.
    on_cpu = {"xla_cpu_experimental_ynn_fusion_type": ""}
    return on_cpu if jax.default_backend() == "cpu" else {}


def begin(config: Config, warmup: Transitions, scale: Scale) -> AgentState:
    """The state before the first epoch."""
    key = named(jax.random.key(config.seed), "agent")
    make = eqx.filter_jit(lambda warmup, scale, key: algorithm.init(config, warmup, scale, key=key))
    return jax.tree.map(lambda x: own(x) if eqx.is_array(x) else x, make(warmup, scale, key))
