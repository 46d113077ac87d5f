"""Agents on disk: files that load without running code, and say when they are damaged.

`agent.safetensors` has the models' arrays, `agent.json` what is needed to build the models around
them, checksums of itself and of the others, and what the body's model compiled to. An agent whose
body is a model file of its user's has a copy of that in `body/`.
"""

import hashlib
import json
import shutil
import warnings
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from typing import Any, Literal, NamedTuple, get_args

import jax.numpy as jnp
import numpy as np
import safetensors
import safetensors.numpy
from jaxtyping import Float32

from everystate.agent import formats, sharing
from everystate.agent.arrays import named_arrays, skeleton, with_arrays
from everystate.agent.json_files import (
    config_from_json,
    config_to_json,
    model_copy,
    read_json,
    with_model_copy,
)
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.learning.facing import Horizontal
from everystate.learning.models import Models, Scale, Space

ActWith = Literal["policy", "plan"]
"""What an agent is best driven by: its policy alone, or the search ahead of planning."""

BODY = "body"
"""The folder with the copy of a model, in a run as in an agent."""
_ARRAYS, _LIST = "agent.safetensors", f"{BODY}/body.json"
_VISITED = "visited"
"""Among the arrays: no part of a model."""
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
    model_hash: str = ""
    """What the model that it learned on compiled to; "" where that is not known."""
    versions: Mapping[str, str] = {}
    """Of the packages that the body came from."""
    action_names: tuple[str, ...] = ()
    """Empty where they are not known."""
    horizontal: Horizontal = ()
    """Components of a state that turn with the body on level ground: see `learning.facing`."""

    @property
    def space(self) -> Space:
        """What models must know of it."""
        return Space(len(self.state_names), self.action_size, self.horizontal)


def export(path: Path, *agent_and_scores: Any) -> Path:
    """`write` to a new folder or, as NAME.zip, one file; which appears whole or not at all."""
    if path.exists():
        raise EverystateError(f"{path} exists already: export to another place")
    draft = path.with_name(f".{path.name}.draft")
    try:
        shutil.rmtree(draft, ignore_errors=True)
        draft.mkdir(parents=True)
        write(draft, *agent_and_scores)
        if path.suffix == sharing.ARCHIVE:
            sharing.pack(draft, path)
            shutil.rmtree(draft)
        else:
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
    act_with: ActWith = "policy",
    visited: Float32[np.ndarray, "n state"] | None = None,
    scores: Mapping[str, Any] | None = None,
    half: bool = False,
) -> None:
    """Writes an agent's files into an existing folder; if `half`, matrices as float16."""
    arrays = {name: np.asarray(x) for name, x in named_arrays(models).items()}
    if visited is not None:
        arrays[_VISITED] = visited
    if half:
        arrays = {name: _halved(x) for name, x in arrays.items()}
    safetensors.numpy.save_file(arrays, folder / _ARRAYS)
    names = [_ARRAYS]
    if copy := model_copy(config):
        _copy_body(copy, folder / BODY)
        names.append(_LIST)
    description = {
        "format": formats.FORMAT,
        "everystate": version("everystate"),
        "config": config_to_json(config),
        "body": body._asdict() | {"versions": dict(body.versions)},
        "scale": {name: np.asarray(x).tolist() for name, x in scale._asdict().items()},
        "act_with": act_with,
        "scores": dict(scores or {}),
        "files": {name: _checksum((folder / name).read_bytes()) for name in names},
    }
    description["checksum"] = _own_checksum(description)
    (folder / "agent.json").write_text(json.dumps(description, indent=2) + "\n")


def _halved(array: np.ndarray) -> np.ndarray:
    # Vectors are scales too, which may be too small for it, and take no room.
    return array.astype(np.float16) if array.dtype == np.float32 and array.ndim > 1 else array


def _full(array: np.ndarray) -> np.ndarray:
    return array.astype(np.float32) if array.dtype == np.float16 else array


def read(
    folder: Path, body_folder: Path | None = None
) -> tuple[Models, Scale, Config, BodyInfo, ActWith, Float32[np.ndarray, "n state"] | None]:
    """The inverse of `write`, scores apart; where nothing is said, the policy acts.

    Args:
        folder: has the agent's files.
        body_folder: where to find the copy of the model, by default `body/` beside them.

    Raises:
        EverystateError: the files are damaged or of another version.
    """
    try:
        description = read_json(folder / "agent.json")
        _require_sound(folder, description)
        found = description["format"]
        config = config_from_json(formats.config_of_today(description["config"], found))
        body = BodyInfo(**description["body"])
        names = {n: tuple(getattr(body, n)) for n in ("state_names", "action_names")}
        horizontal = tuple((int(x), int(y)) for x, y in body.horizontal)
        body = body._replace(versions=dict(body.versions), horizontal=horizontal, **names)
        act_with = description.get("act_with", "policy")
        if act_with not in get_args(ActWith):
            raise ValueError(f"act_with is {act_with!r}: expected policy or plan")
        content = (folder / _ARRAYS).read_bytes()
        files = dict(description.get("files", {_ARRAYS: _checksum(content)}))
        _require_same(folder / _ARRAYS, content, files[_ARRAYS])
        if _LIST in files:
            place = body_folder or folder / BODY
            listed = place / PurePosixPath(_LIST).name
            _require_same(listed, listed.read_bytes(), files[_LIST])
            config = with_model_copy(config, place)
        models = skeleton(config, body.space).models
        arrays = safetensors.numpy.load(content)
        arrays = {n: _full(x) for n, x in arrays.items()}
        visited = arrays.pop(_VISITED, None)
        sizes = len(body.state_names), config.frequencies
        arrays = formats.brought_up(arrays, found, *sizes)
        models = with_arrays(models, {name: jnp.asarray(x) for name, x in arrays.items()})
        units = {name: jnp.asarray(x, jnp.float32) for name, x in description["scale"].items()}
        return models, Scale(**units), config, body, act_with, visited
    except EverystateError as error:
        raise EverystateError(f"the agent in {folder} cannot be read: {error}") from error
    except _PROBLEMS as error:
        problem = " ".join(f"{type(error).__name__}: {error}".split())
        raise EverystateError(f"the agent in {folder} is damaged ({problem})") from error


def _require_sound(folder: Path, description: Mapping[str, Any]) -> None:
    """Raises if agent.json is of a format that is not read, or is not what was written."""
    if description["format"] == formats.UNCHECKED and "checksum" not in description:
        body = description["config"]["body"]
        return warnings.warn(
            f"the agent in {folder} has format {formats.UNCHECKED}, without checksums: neither"
            f" damage nor another {body} than it learned on is noticed. Export it anew:"
            f" everystate.load({str(folder)!r}).export(NEW_FOLDER)",
            stacklevel=4,
        )
    if description["format"] not in formats.READ:
        raise EverystateError(
            f"the agent in {folder} has format {description['format']} and this everystate "
            f"reads format {formats.FORMAT}: use everystate {description['everystate']}"
        )
    if description["checksum"] != _own_checksum(description):
        raise ValueError("agent.json has another checksum than when it was written")


def _require_same(path: Path, content: bytes, checksum: str) -> None:
    if _checksum(content) != checksum:
        raise ValueError(f"{path} has another checksum than when the agent was written")


def _own_checksum(description: Mapping[str, Any]) -> str:
    """Of all that agent.json says, but not of how it is laid out."""
    rest = json.loads(json.dumps({n: x for n, x in description.items() if n != "checksum"}))
    return _checksum(json.dumps(rest, sort_keys=True).encode())


def _checksum(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _copy_body(source: Path, target: Path) -> None:
    """A copy of the files that a copied model lists, and of no others."""
    name = PurePosixPath(_LIST).name
    try:
        listed = [PurePosixPath(one) for one in read_json(source / name)["files"]]
    except (ValueError, KeyError, TypeError) as error:
        raise EverystateError(f"{source / name} is damaged: {error}") from error
    for one in (PurePosixPath(name), *listed):
        if one.is_absolute() or ".." in one.parts:
            raise EverystateError(f"{source / name} names {one}: it must lie in that folder")
        (target / one).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / one, target / one)
