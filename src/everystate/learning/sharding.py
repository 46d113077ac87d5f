"""The examples of a minibatch shared out among devices; all else lies whole on each of them.

Random numbers are drawn with the same keys and in the same shapes however many devices there are,
so that these change only the order in which sums are added up. On one device all of this is
nothing: the program is the same as without it.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec

from everystate.config import Config

AXIS = "devices"


def mesh(config: Config) -> Mesh:
    """The first `config.devices` of all hosts' devices, in a row."""
    devices = jax.devices()[: config.devices]
    return jax.make_mesh((config.devices,), (AXIS,), (AxisType.Auto,), devices=devices)


def whole(config: Config) -> NamedSharding:
    """Of arrays that every device has a copy of."""
    return NamedSharding(mesh(config), PartitionSpec())


def split(config: Config, examples: Any) -> Any:
    """The same arrays [batch, ...], of which each device holds and works out its own share.

    What is computed from them example by example is shared out with them, and their means become
    sums over devices.
    """
    if config.devices == 1:
        return examples
    return jax.lax.with_sharding_constraint(
        examples, NamedSharding(mesh(config), PartitionSpec(AXIS))
    )


def joined(config: Config, examples: Any) -> Any:
    """The inverse of `split`: every device has all examples."""
    if config.devices == 1:
        return examples
    return jax.lax.with_sharding_constraint(examples, whole(config))


def on_each_device(config: Config, function: Callable, everything: Any, *examples: Any) -> Any:
    """`function(everything, *examples)`, which each device calls with its share of the examples.

    For what depends on the examples in its course, as a loop does that ends when all are done: no
    device waits for another's. Examples and results are arrays [batch, ...]; of `everything` each
    device has the whole.
    """
    if config.devices == 1:
        return function(everything, *examples)
    arrays, static = eqx.partition(everything, eqx.is_array)

    def of_arrays(arrays: Any, *examples: Any) -> Any:
        return function(eqx.combine(arrays, static), *examples)

    share, copy = PartitionSpec(AXIS), PartitionSpec()
    # No type says what varies between devices: the loops' first values, zeros, would not say so.
    return jax.shard_map(
        of_arrays,
        mesh=mesh(config),
        in_specs=(copy, *(share for _ in examples)),
        out_specs=share,
        check_vma=False,
    )(arrays, *examples)
