"""The algorithm's functions, compiled once for a run."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from everystate import algorithm
from everystate.agent import is_array, own, skeleton
from everystate.config import Config
from everystate.learning import draws as chance
from everystate.learning.draws import Draws
from everystate.learning.episodes import Episodes
from everystate.learning.guard import Fault
from everystate.learning.keys import named
from everystate.learning.models import Scale, Space
from everystate.learning.replay import Transitions
from everystate.learning.sharding import whole
from everystate.learning.state import Actor, AgentState
from everystate.training import hosts
from everystate.training.programs import kept

Observations = Float[Array, "bodies s"] | Float[np.ndarray, "bodies s"]
Tree = TypeVar("Tree", AgentState, Actor)


class Learner(NamedTuple):
    """`draw`, `act`, `observe` and `update` of the algorithm, for one config.

    Over several devices and hosts, all must call the last two alike, where the first host's steps
    and episodes count; the first two are one host's own affair, on one device.
    """

    draw: Callable[[AgentState], Draws]
    act: Callable[[Actor, Episodes, Draws, Observations], tuple[Episodes, Array]]
    """Of all bodies or of a group of them, anywhere."""
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

    def drawn(state: AgentState) -> Draws:
        return chance.draw(config, state)

    def acted(
        actor: Actor, episodes: Episodes, draws: Draws, observations: Float[Array, "bodies s"]
    ) -> tuple[Episodes, Array]:
        return algorithm.act(config, actor, episodes, draws, observations)

    def observed(state: AgentState, steps: Transitions) -> list[Array]:
        return _arrays(algorithm.observe(config, state, steps))

    def updated(state: AgentState) -> tuple[list[Array], dict[str, Array], Fault]:
        state, metrics, fault = algorithm.update(config, state)
        return _arrays(state), metrics, fault

    everywhere = {} if config.devices == 1 else {"out_shardings": whole(config)}
    observing = _of_arrays("observe", config, observed, **everywhere)
    updating = _of_arrays("update", config, updated, donate_argnums=0, **everywhere)

    def observe(state: AgentState, steps: Transitions) -> AgentState:
        episodes, steps = hosts.shared(config, (state.episodes, steps))
        state = state._replace(episodes=episodes)
        return _structure(state)(observing(state, steps))

    def update(state: AgentState) -> tuple[AgentState, dict[str, Array], Fault]:
        arrays, metrics, fault = updating(state)
        return _structure(state)(arrays), metrics, fault

    draw, act = _of_arrays("draw", config, drawn), _of_arrays("act", config, acted)
    return Learner(draw, act, observe, update)


def _of_arrays(name: str, config: Config, function: Callable, **options: Any) -> Callable:
    """A function of a tree, compiled as one of its arrays; what else it has is always the same."""
    made: dict[str, Callable] = {}

    def call(tree: Tree, *more: Any) -> Any:
        arguments = (_arrays(tree), *more)
        if name not in made:
            put_in = _structure(tree)  # and not the tree, whose arrays would stay in memory

            def of_arrays(arrays: list[Array], *more: Any) -> Any:
                return function(put_in(arrays), *more)

            options["compiler_options"] = _compiler_options()
            made[name] = kept(name, config, tree.horizontal, of_arrays, arguments, **options)
        return made[name](*arguments)

    return call


def _arrays(tree: Any) -> list[Array]:
    return jax.tree.leaves(eqx.filter(tree, eqx.is_array))


def _structure(tree: Tree) -> Callable[[list[Array]], Tree]:
    """Puts arrays in the place of a tree's own, or of their shapes."""
    dynamic, static = eqx.partition(tree, is_array)
    structure = jax.tree.structure(dynamic)
    return lambda arrays: eqx.combine(jax.tree.unflatten(structure, arrays), static)


def _compiler_options() -> dict[str, str]:
    # XLA's own loops over few elements are quicker than the YNNPACK calls it would make of them.
    on_cpu = {"xla_cpu_experimental_ynn_fusion_type": ""}
    return on_cpu if jax.default_backend() == "cpu" else {}


def begin(config: Config, space: Space, warmup: Transitions, scale: Scale) -> AgentState:
    """The state before the first epoch."""
    arguments = warmup, scale, named(jax.random.key(config.seed), "agent")
    if config.flow != "pldu":
        # FlowJAX keeps first parameters in functions, where those of a trace must not remain.
        begun = _begun(config, space, *arguments)
        return jax.tree.map(lambda x: own(x) if eqx.is_array(x) else x, begun)
    alike = dataclasses.replace(config, seed=0, body_options=())
    arrays = _beginning(alike, space)(*arguments)
    return _structure(skeleton(config, space))([own(x) for x in arrays])


@functools.lru_cache(maxsize=4)
def _beginning(config: Config, space: Space) -> Callable[..., list[Array]]:
    """What makes a new state's arrays: traced for the first of the runs of a process alike."""
    program: list[Callable[..., list[Array]]] = []

    def made(*arguments: Any) -> list[Array]:
        return _arrays(_begun(config, space, *arguments))

    def call(*arguments: Any) -> list[Array]:
        if not program:
            # Run once: what optimising it would save is far less than it costs.
            options: dict[str, Any] = {"compiler_options": {"xla_backend_optimization_level": 0}}
            program.append(kept("init", config, space.horizontal, made, arguments, **options))
        return program[0](*arguments)

    return call


def _begun(
    config: Config, space: Space, warmup: Transitions, scale: Scale, key: PRNGKeyArray
) -> AgentState:
    return algorithm.init(config, space, warmup, scale, key=key)
