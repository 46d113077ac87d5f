"""The algorithm's functions, compiled once for a run."""

import functools
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from everystate import algorithm
from everystate.algorithm import AgentState, Scale
from everystate.config import Config
from everystate.learning.guard import Fault
from everystate.learning.keys import named
from everystate.learning.replay import Transitions


class Learner(NamedTuple):
    """`act`, `observe` and `update` of the algorithm, for one config."""

    act: Callable[[AgentState, Float[Array, "bodies s"]], tuple[AgentState, Array]]
    observe: Callable[[AgentState, Transitions], AgentState]
    update: Callable[[AgentState], tuple[AgentState, dict[str, Float[Array, ""]], Fault]]
    """Its argument is used up: the new state takes over its memory."""


def jit(function: Callable, *, donate: Literal["all", "none"] = "none") -> Any:
    """Compiled as the algorithm's functions are; see `equinox.filter_jit` for `donate`."""
    # XLA's own loops over few elements are quicker than the YNNPACK calls it would make of them.
    on_cpu = {"xla_cpu_experimental_ynn_fusion_type": ""}
    options = on_cpu if jax.default_backend() == "cpu" else {}
    more: dict[str, Any] = {"donate": donate, "compiler_options": options}
    return eqx.filter_jit(function, **more)


@functools.lru_cache(maxsize=4)
def compiled(config: Config) -> Learner:
    """Compiles on first use; never again, because states keep their shapes and dtypes."""

    def changed_by_act(state: AgentState, observations: Float[Array, "bodies s"]) -> Any:
        after, actions = algorithm.act(config, state, observations)
        return after.episodes, after.step, actions

    acting = jit(changed_by_act)

    def act(
        state: AgentState, observations: Float[Array, "bodies s"]
    ) -> tuple[AgentState, Float[Array, "bodies a"]]:
        # The rest stays outside: what goes through a program is copied, all of replay at each step.
        episodes, step, actions = acting(state, observations)
        return state._replace(episodes=episodes, step=step), actions

    return Learner(
        act=act,
        observe=jit(lambda state, steps: algorithm.observe(config, state, steps)),
        update=jit(lambda state: algorithm.update(config, state), donate="all"),
    )


def begin(config: Config, warmup: Transitions, scale: Scale) -> AgentState:
    """The state before the first epoch."""
    key = named(jax.random.key(config.seed), "agent")
    make = eqx.filter_jit(lambda warmup, scale, key: algorithm.init(config, warmup, scale, key=key))
    # Own memory for every array, or `update` could not take it over, and no weak dtypes, which
    # would make the first epoch's functions other ones than the second's.
    return jax.tree.map(_own, make(warmup, scale, key))


def _own(leaf):
    if not eqx.is_array(leaf) or jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        return leaf
    return jnp.array(leaf, leaf.dtype)
