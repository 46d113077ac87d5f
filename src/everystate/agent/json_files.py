"""What is kept as JSON: objects, lines of objects, and configs."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from everystate.config import MODEL_COPY, Config
from everystate.errors import EverystateError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


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


def config_to_plain(config: "DataclassInstance") -> dict[str, Any]:
    """The fields of a config, with lists for tuples.

    Where a copy of the model lies is left out: that is true of this machine only.
    """
    values = asdict(config)
    if "body_options" in values:
        values["body_options"] = [x for x in values["body_options"] if not _is_model_copy(x)]
    return {name: list(x) if isinstance(x, tuple) else x for name, x in values.items()}


def config_to_json(config: "DataclassInstance") -> dict[str, Any]:
    """`config_to_plain`, where infinity is a string: JSON has none."""
    return {
        name: str(x) if isinstance(x, float) and math.isinf(x) else x
        for name, x in config_to_plain(config).items()
    }


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


def with_model_copy(config: Config, folder: Path) -> Config:
    """The same body, built from a copy of its model from now on."""
    rest = [x for x in config.body_options if not _is_model_copy(x)]
    return replace(config, body_options=(*rest, f"{MODEL_COPY}={folder.resolve()}"))


def model_copy(config: Config) -> Path | None:
    """The folder with the copy of the model, if the body is built from one."""
    found = [x.partition("=")[2] for x in config.body_options if _is_model_copy(x)]
    return Path(found[-1]) if found else None


def _is_model_copy(option: str) -> bool:
    return option.startswith(f"{MODEL_COPY}=")
