"""Agents on disk: two files that load without running code.

`agent.safetensors` has the models' arrays, `agent.json` what is needed to build the models around
them.
"""

import json
import math
import shutil
from collections.abc import Mapping
from dataclasses import asdict, fields
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import safetensors
import safetensors.numpy

from everystate.agent.arrays import named_arrays, skeleton, with_arrays
from everystate.algorithm import Models, Scale
from everystate.config import Config
from everystate.errors import EverystateError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

FORMAT = 2
_PROBLEMS = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    OverflowError,
    safetensors.SafetensorError,
)
"""What reading a damaged agent may raise; JSON may have anything in the place of anything."""


class BodyInfo(NamedTuple):
    """What an agent must know about its body."""

    state_names: tuple[str, ...]
    action_size: int


def export(path: Path, *agent_and_scores: Any) -> Path:
    """`write` to a new folder, which appears whole or not at all."""
    if path.exists():
        raise EverystateError(f"{path} exists already: export to a new folder")
    draft = path.with_name(f".{path.name}.draft")
    try:
        shutil.rmtree(draft, ignore_errors=True)
        draft.mkdir(parents=True)
        write(draft, *agent_and_scores)
        draft.rename(path)
    except OSError as error:
        raise EverystateError(f"cannot export to {path}: {error.strerror}") from error
    return path


def write(
    folder: Path,
    models: Models,
    scale: Scale,
    config: Config,
    body: BodyInfo,
    scores: Mapping[str, Any] | None = None,
    half: bool = False,
) -> None:
    """Writes an agent's two files into an existing folder; if `half`, matrices as float16."""
    description = {
        "format": FORMAT,
        "everystate": version("everystate"),
        "config": config_to_json(config),
        "body": body._asdict(),
        "scale": {name: np.asarray(x).tolist() for name, x in scale._asdict().items()},
        "scores": dict(scores or {}),
    }
    arrays = {name: np.asarray(x) for name, x in named_arrays(models).items()}
    if half:
        arrays = {name: _halved(x) for name, x in arrays.items()}
    safetensors.numpy.save_file(arrays, folder / "agent.safetensors")
    (folder / "agent.json").write_text(json.dumps(description, indent=2) + "\n")


def _halved(array: np.ndarray) -> np.ndarray:
    # Vectors are scales too, which may be too small for it, and take no room.
    return array.astype(np.float16) if array.dtype == np.float32 and array.ndim > 1 else array


def read(folder: Path) -> tuple[Models, Scale, Config, BodyInfo]:
    """The inverse of `write`, scores apart.

    Raises:
        EverystateError: the files are damaged or of another version.
    """
    try:
        description = read_json(folder / "agent.json")
        if description["format"] != FORMAT:
            raise EverystateError(
                f"the agent in {folder} has format {description['format']} and this everystate "
                f"reads format {FORMAT}: use everystate {description['everystate']}"
            )
        config = config_from_json(description["config"])
        body = BodyInfo(**description["body"])
        body = body._replace(state_names=tuple(body.state_names))
        models = skeleton(config, len(body.state_names), body.action_size).models
        arrays = safetensors.numpy.load_file(folder / "agent.safetensors")
        arrays = {n: np.float32(x) if x.dtype == np.float16 else x for n, x in arrays.items()}
        models = with_arrays(models, {name: jnp.asarray(x) for name, x in arrays.items()})
        units = {name: jnp.asarray(x, jnp.float32) for name, x in description["scale"].items()}
        return models, Scale(**units), config, body
    except _PROBLEMS as error:
        problem = " ".join(f"{type(error).__name__}: {error}".split())
        raise EverystateError(f"the agent in {folder} is damaged ({problem})") from error


def read_json(path: Path) -> dict[str, Any]:
    """The JSON object in a file.

    Raises:
        OSError: it cannot be read.
        ValueError: it holds no JSON object, or one that is nested too deeply.
    """
    try:
        value = json.loads(path.read_text())
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    if not isinstance(value, dict):
        raise ValueError(f"expected an object, found {type(value).__name__}")
    return value


def read_lines(path: Path) -> list[dict[str, Any]]:
    """The JSON objects of a file with one a line, up to the first line that is none.

    A run that was killed may have left its last line cut short.
    """
    found = []
    for line in path.read_text(errors="replace").splitlines() if path.exists() else []:
        try:
            value = json.loads(line)
        except (ValueError, RecursionError):
            break
        if not isinstance(value, dict):
            break
        found.append(value)
    return found


def config_to_json(config: "DataclassInstance") -> dict[str, Any]:
    """The fields of a config; JSON has no infinity, so that one is a string, and no tuple."""
    values = {
        name: str(x) if isinstance(x, float) and math.isinf(x) else x
        for name, x in asdict(config).items()
    }
    return {name: list(x) if isinstance(x, tuple) else x for name, x in values.items()}


def config_from_json(values: Mapping[str, Any]) -> Config:
    """The inverse of `config_to_json`.

    Raises:
        EverystateError: a field is unknown, as from another version, or out of range.
    """
    known = {field.name: field.type for field in fields(Config)}
    for name in values:
        if name not in known:
            raise EverystateError(f"config field {name!r} is not one of this everystate's")
    typed: dict[str, Any] = {
        name: float(x) if known[name] is float else x for name, x in values.items()
    }
    if "body_options" in typed:
        typed["body_options"] = tuple(typed["body_options"])
    return Config(**typed)
