"""Several devices, and several hosts: the first leads the run, the others lend it their devices.

The first host has the bodies and the run's folder, and does all that it would do alone; each other
one only takes part in `observe` and `update`. Of these every host runs the same program over all
devices, in which JAX has them exchange what they must. So hosts need no common file system, bodies
need not do the same on each, and the wire carries an epoch's transitions once.
"""

import json
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import multihost_utils

from everystate.agent import config_to_json
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.learning.sharding import whole


def join(hosts: int, coordinator: str | None, host_id: int | None) -> None:
    """Makes this process one of several; before anything is computed.

    Args:
        hosts: how many processes there are.
        coordinator: HOST:PORT at which the first of them is to be found by all.
        host_id: this one's number, 0 for the first. These two may be None where JAX finds them
            out by itself: under SLURM, Open MPI and Kubernetes.

    Raises:
        EverystateError: one is missing or wrong, or the others do not come.
    """
    try:
        jax.distributed.initialize(coordinator, hosts, host_id)
    except (ValueError, TypeError, IndexError, RuntimeError) as error:
        problem = " ".join(str(error).split())[:300]
        raise EverystateError(
            f"cannot join {hosts} hosts ({problem}): give each of them --hosts {hosts}, the same "
            f"--coordinator HOST:PORT and its own --host-id from 0 to {hosts - 1}"
        ) from error


def leads() -> bool:
    """Whether this process is the first, or the only one."""
    return jax.process_index() == 0


def check(config: Config) -> None:
    """That the devices are there, and that all hosts have been told the same.

    Raises:
        EverystateError: they are not, or have not.
    """
    there, hosts = jax.device_count(), jax.process_count()
    if config.devices > there or (hosts > 1 and config.devices != there):
        on_cpu = (
            f"; of a CPU, XLA_FLAGS=--xla_force_host_platform_device_count="
            f"{max(1, config.devices // hosts)} in the environment makes so many"
            if jax.default_backend() == "cpu"
            else ""
        )
        raise EverystateError(
            f"devices = {config.devices}, but JAX has {there} on {hosts} host(s): choose "
            f"--devices {there}{on_cpu}"
        )
    if hosts > 1:
        each = Counter(device.process_index for device in jax.devices())
        if len(set(each.values())) > 1:
            raise EverystateError(
                f"the hosts have {', '.join(map(str, each.values()))} devices: hide some from JAX, "
                f"as by CUDA_VISIBLE_DEVICES, so that each has as many"
            )
        text = json.dumps(config_to_json(config), sort_keys=True)
        if len(set(multihost_utils.process_allgather(np.uint32(zlib.crc32(text.encode()))))) > 1:
            raise EverystateError(
                "the hosts were told to train by different configs: start each of them by the "
                "same command, but for --host-id"
            )


@contextmanager
def leading() -> Iterator[None]:
    """At its end, also by an error of ours, the other hosts are told that they can go.

    Any other exception may come in the middle of something that they take part in: JAX ends them
    when this process ends.

    Raises:
        EverystateError: one of them was lost.
    """
    try:
        yield
    except jax.errors.JaxRuntimeError as error:
        if jax.process_count() == 1:
            raise
        problem = " ".join(str(error).split())[:200]
        raise EverystateError(
            f"another host was lost, or something failed on all ({problem}): the last checkpoint "
            f"is kept; start all hosts again, and the same commands go on from there"
        ) from error
    except EverystateError:
        with suppress(jax.errors.JaxRuntimeError):  # They may have met the same, and be gone.
            go_on(False)
        raise
    go_on(False)


def go_on(so: bool = True) -> bool:
    """Whether the first host goes on, which tells the others so; these wait for its word."""
    return bool(_from_first([np.array(so)])[0])


def shared(config: Config, tree: Any) -> Any:
    """A tree whose arrays are those of the first host, and lie whole on every device."""
    if config.devices == 1:
        return tree
    if jax.process_count() == 1:
        return _map(lambda x: jax.device_put(x, whole(config)), tree)
    arrays, static = eqx.partition(tree, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)
    keys = [jnp.issubdtype(x.dtype, jax.dtypes.prng_key) for x in leaves]
    numbers = [
        np.asarray(jax.random.key_data(x) if is_key else x)
        for x, is_key in zip(leaves, keys, strict=True)
    ]
    everywhere = [
        jax.random.wrap_key_data(_put(config, x)) if is_key else _put(config, x)
        for x, is_key in zip(_from_first(numbers), keys, strict=True)
    ]
    return eqx.combine(jax.tree.unflatten(structure, everywhere), static)


def local(tree: Any) -> Any:
    """The same arrays as this host's first device has them, for programs of that device alone."""
    return _map(lambda x: x.addressable_data(0), tree)


def _from_first(arrays: list[np.ndarray]) -> list[np.ndarray]:
    """The first host's arrays, bit for bit; the others' have only their shapes and dtypes."""
    if jax.process_count() == 1:
        return arrays
    # As bytes, which are added to zeros: that would make 0.0 of a float's -0.0.
    row = np.concatenate([np.ascontiguousarray(x).reshape(-1).view(np.uint8) for x in arrays])
    row = np.asarray(multihost_utils.broadcast_one_to_all(row))
    parts = np.split(row, np.cumsum([x.nbytes for x in arrays])[:-1])
    return [part.view(x.dtype).reshape(x.shape) for part, x in zip(parts, arrays, strict=True)]


def _put(config: Config, array: np.ndarray) -> jax.Array:
    return jax.make_array_from_callback(array.shape, whole(config), lambda index: array[index])


def _map(function: Callable, tree: Any) -> Any:
    return jax.tree.map(lambda x: function(x) if eqx.is_array(x) else x, tree)
