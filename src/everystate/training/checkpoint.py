"""Checkpoints: all that decides how a run goes on, so that it goes on bit for bit.

A checkpoint is a folder `checkpoints/EPOCH` that appears whole or not at all. `state.safetensors`
has everything, with a checksum of every array. It is also an exported agent, so that whoever wants
only the agent need not know what else a run holds.
"""

import shutil
import warnings
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import safetensors
import safetensors.numpy
from jaxtyping import Bool, Float32

from everystate.agent import Agent, files, named_arrays, own, skeleton, with_arrays
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.learning.models import Space
from everystate.learning.state import AgentState

KEPT = 2
_STATE = "state.safetensors"


class Snapshot(NamedTuple):
    """A run between two epochs."""

    agent: AgentState
    env: tuple[dict[str, np.ndarray], ...]
    """Each group's physics and random numbers, as its bodies' `get_state` has it."""
    observations: Float32[np.ndarray, "bodies s"]
    """What the bodies observe now."""
    visited: Bool[np.ndarray, "..."]
    """Cells of the body's space that were ever visited."""

    @property
    def epoch(self) -> int:
        """How many epochs lie behind it."""
        return int(self.agent.epoch)


def save(folder: Path, snapshot: Snapshot, agent: Agent, period: int) -> Path:
    """Writes a checkpoint, unless that epoch has one, and removes those no longer needed.

    The last two stay, and of the older ones those after 1, 2, 4, 8, ... periods.

    Raises:
        EverystateError: it cannot be written; those before it stay.
    """
    checkpoint = folder / f"{snapshot.epoch:06d}"
    if checkpoint.exists():
        return checkpoint
    draft = folder / f".draft-{checkpoint.name}"
    shutil.rmtree(draft, ignore_errors=True)
    try:
        _write(draft, snapshot, agent)
        draft.rename(checkpoint)
    except (OSError, safetensors.SafetensorError) as error:
        shutil.rmtree(draft, ignore_errors=True)
        problem = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        raise EverystateError(
            f"checkpoint {checkpoint} cannot be written ({problem}): those before it are kept;"
            f" make room, and the same command goes on from there"
        ) from error
    for old in _saved(folder)[:-KEPT]:
        periods, rest = divmod(int(old.name), period)
        if rest or periods.bit_count() != 1:  # no power of two
            shutil.rmtree(old)
    return checkpoint


def _write(draft: Path, snapshot: Snapshot, agent: Agent) -> None:
    draft.mkdir(parents=True)
    arrays = _to_arrays(snapshot)
    checksums = {name: str(_checksum(array)) for name, array in arrays.items()}
    safetensors.numpy.save_file(arrays, draft / _STATE, metadata=checksums)
    parts = agent.models, agent.scale, agent.config, agent.body, agent.act_with, agent.visited
    files.write(draft, *parts)


def restore(folder: Path, config: Config, space: Space) -> Snapshot | None:
    """The latest checkpoint that is sound, or None where there is none at all.

    Damaged ones are set aside, under another name, with a warning.

    Raises:
        EverystateError: there are checkpoints, but none is sound.
    """
    problem, like = None, skeleton(config, space)
    for checkpoint in reversed(_saved(folder)):
        try:
            snapshot = _read(checkpoint, like)
        except (OSError, ValueError, KeyError, TypeError, safetensors.SafetensorError) as error:
            problem = " ".join(f"{type(error).__name__}: {error}".split())[:200]
            warnings.warn(f"checkpoint {checkpoint} is damaged ({problem})", stacklevel=2)
            continue
        for damaged in _saved(folder):
            if damaged.name > checkpoint.name:
                _set_aside(damaged)
        return snapshot
    if problem:
        raise EverystateError(
            f"no checkpoint in {folder} is sound ({problem}): start anew in another --run-dir"
        )
    return None


def _read(checkpoint: Path, like: AgentState) -> Snapshot:
    with safetensors.safe_open(checkpoint / _STATE, framework="numpy") as file:
        arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        checksums = file.metadata()
    if checksums is None or checksums.keys() != arrays.keys():
        raise ValueError("arrays are missing")
    for name, array in arrays.items():
        if checksums[name] != str(_checksum(array)):
            raise ValueError(f"{name} has another checksum than when it was written")
    return _from_arrays(arrays, like)


def _to_arrays(snapshot: Snapshot) -> dict[str, np.ndarray]:
    agent = {
        f"agent.{name}": jax.random.key_data(x) if _is_key(x) else x
        for name, x in named_arrays(snapshot.agent).items()
    }
    groups = enumerate(snapshot.env)
    env = {f"env.{i}.{name}": x for i, state in groups for name, x in state.items()}
    rest = {"observations": snapshot.observations, "visited": snapshot.visited}
    return {name: np.asarray(x, order="C") for name, x in (agent | env | rest).items()}


def _from_arrays(arrays: Mapping[str, np.ndarray], expected: AgentState) -> Snapshot:
    def under(prefix: str) -> dict[str, np.ndarray]:
        return {n.removeprefix(prefix): x for n, x in arrays.items() if n.startswith(prefix)}

    agent = {name: own(x) for name, x in under("agent.").items()}
    for name, x in named_arrays(expected).items():
        if _is_key(x):
            agent[name] = jax.random.wrap_key_data(agent[name])
    groups = len({name.partition(".")[0] for name in under("env.")})
    env = tuple(under(f"env.{i}.") for i in range(groups))
    return Snapshot(with_arrays(expected, agent), env, arrays["observations"], arrays["visited"])


def _saved(folder: Path) -> list[Path]:
    return sorted(folder.glob("[0-9]*"))


def _set_aside(checkpoint: Path) -> None:
    names = (checkpoint.with_name(f"damaged-{checkpoint.name}-{i}") for i in range(1, 1000))
    checkpoint.rename(next(name for name in names if not name.exists()))


def _checksum(array: np.ndarray) -> int:
    return zlib.crc32(array.tobytes())


def _is_key(leaf: Any) -> bool:
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
