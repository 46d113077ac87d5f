"""Pytrees as arrays with names, which is all that files know."""

import functools
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from everystate.algorithm import init
from everystate.config import Config
from everystate.learning.models import Scale, Space
from everystate.learning.replay import Transitions
from everystate.learning.state import AgentState


@functools.lru_cache(maxsize=8)
def skeleton(config: Config, space: Space) -> AgentState:
    """The agent state of a new run, with shapes and dtypes in place of arrays: costs no memory."""
    # FlowJAX keeps first parameters in functions, where those of a trace must not remain.
    traced = config.flow == "pldu"

    def like(*shape: int) -> Any:
        return jax.ShapeDtypeStruct(shape, jnp.float32) if traced else jnp.zeros(shape)

    leading = (config.warmup_steps, config.num_bodies)
    states, actions = like(*leading, space.state_size), like(*leading, space.action_size)
    warmup = Transitions(states, actions, states, states)
    scale = Scale(like(space.state_size), like(space.state_size))
    key = jax.random.key(0)
    if traced:
        return eqx.filter_eval_shape(init, config, space, warmup, scale, key=key)
    state = init(config, space, warmup, scale, key=key)
    return jax.tree.map(
        lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype) if eqx.is_array(x) else x, state
    )


def named_arrays(tree: Any) -> dict[str, Any]:
    """The arrays of a pytree (or what stands for them) by their place in it."""
    leaves = jax.tree_util.tree_leaves_with_path(eqx.filter(tree, is_array))
    return {jax.tree_util.keystr(path, simple=True, separator="."): x for path, x in leaves}


def with_arrays(tree: Any, arrays: Mapping[str, Any]) -> Any:
    """The same pytree with other arrays, named as by `named_arrays`.

    Raises:
        ValueError: a name, a shape or a dtype is not the tree's.
    """
    expected = named_arrays(tree)
    for name in [*expected, *arrays]:
        form = [(x[name].shape, x[name].dtype) if name in x else None for x in (expected, arrays)]
        if form[0] != form[1]:
            raise ValueError(f"array {name}: expected {form[0]}, found {form[1]}")
    dynamic, static = eqx.partition(tree, is_array)
    found = jax.tree.unflatten(jax.tree.structure(dynamic), [arrays[name] for name in expected])
    return eqx.combine(found, static)


def own(array: Any) -> Array:
    """A copy with memory of its own, no weak dtype, and fixed to this host's first device.

    An update takes over the memory of its arguments; and for arrays of a weak dtype, or fixed to no
    device, it would be compiled once more than for its results, which are neither.
    """
    is_key = jnp.issubdtype(array.dtype, jax.dtypes.prng_key)
    copy = array if is_key else jnp.array(array, array.dtype)
    return jax.device_put(copy, jax.local_devices()[0])


def is_array(leaf: Any) -> bool:
    """Whether it is an array, or stands for one."""
    return isinstance(leaf, jax.ShapeDtypeStruct) or eqx.is_array(leaf)
