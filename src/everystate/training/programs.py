"""Traced programs, kept from one process to the next.

JAX keeps what XLA compiled, but to find it traces the whole of the algorithm through Python again,
which takes half of a warm start. So what tracing made is kept too, by `jax.export`, under a name
that has everything it depends on: this package's source, versions, the config and the arguments.
"""

import hashlib
import json
import os
import warnings
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
from jax import export

from everystate.agent import config_to_json
from everystate.agent.compile_cache import programs_folder
from everystate.config import Config
from everystate.learning.draws import Draws
from everystate.learning.episodes import Episodes
from everystate.learning.facing import Horizontal
from everystate.learning.guard import Batch, Fault
from everystate.learning.models import Scale
from everystate.learning.replay import Minibatch, Transitions

_VERSIONS = ("jax", "jaxlib", "equinox", "flowjax", "optax", "numpy")
_SETTINGS = ("jax_enable_x64", "jax_default_matmul_precision", "jax_threefry_partitionable")

# The classes that programs take and give, but for states, whose arrays they take and give in a row.
for _kind in (Batch, Draws, Episodes, Fault, Minibatch, Scale, Transitions):
    export.register_namedtuple_serialization(_kind, serialized_name=f"everystate.{_kind.__name__}")


def kept(
    name: str,
    config: Config,
    horizontal: Horizontal,
    function: Callable,
    arguments: tuple,
    **options: Any,
) -> Any:
    """`function`, compiled for arguments like these; traced only if no process has done so before.

    Args:
        name: tells apart the programs of a config.
        config: decides, with the next and the arguments' shapes, what the program is.
        horizontal: components that turn with the body, which no array tells.
        function: of arrays in tuples, lists, dictionaries and the classes above.
        arguments: to trace it with.
        **options: of `jax.jit`.
    """
    folder = programs_folder()
    # FlowJAX's flows hold constants of NumPy, which this JAX cannot export. A program over several
    # devices would have to be told apart by their number and hosts: JAX's own cache must do there.
    if folder is None or config.flow != "pldu" or "out_shardings" in options:
        return jax.jit(function, **options)
    path = folder / f"{name}-{_digest(name, config, horizontal, arguments)}.jaxexport"
    try:
        exported = export.deserialize(bytearray(path.read_bytes()))
    except FileNotFoundError:
        exported = _traced(path, function, arguments)
    except Exception as error:  # What a damaged file raises depends on where the damage is.
        warnings.warn(f"{path} is damaged ({type(error).__name__}) and made anew", stacklevel=2)
        exported = _traced(path, function, arguments)
    return jax.jit(exported.call, **options)


def _traced(path: Path, function: Callable, arguments: tuple) -> export.Exported:
    exported = export.export(jax.jit(function))(*arguments)
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_bytes(exported.serialize())
        draft.replace(path)
    except OSError as error:
        warnings.warn(f"cannot keep {path} ({error.strerror})", stacklevel=2)
    return exported


def _digest(name: str, config: Config, horizontal: Horizontal, arguments: tuple) -> str:
    """Of all that a traced program depends on."""
    package = Path(__file__).parents[1]
    sources = [package / "algorithm.py", *sorted((package / "learning").glob("*.py"))]
    shapes = jax.tree.map(lambda x: (str(x.dtype), x.shape), arguments)
    depends = {
        "sources": [hashlib.sha256(path.read_bytes()).hexdigest() for path in sources],
        "versions": [version(package) for package in _VERSIONS],
        "settings": [str(jax.config.values[setting]) for setting in _SETTINGS],
        "backend": jax.default_backend(),
        "config": config_to_json(config) | {"seed": None, "collectors": None},
        "name": name,
        "horizontal": horizontal,
        "arguments": str(shapes),
    }
    return hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest()[:32]
