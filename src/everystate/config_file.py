"""The config of a run as a TOML file: a run writes one, and `everystate train --config` reads it.

    body = "cartpole"
    preset = "quick"       # where the numbers that are not named come from
    batch_size = 128       # any field of `Config`

The file of a run names every field.
"""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from everystate.errors import EverystateError
from everystate.limits import require_kind


def read(path: Path) -> dict[str, Any]:
    """What a file sets: fields of the config, and maybe `preset`.

    Raises:
        EverystateError: it cannot be read, or `body` or `preset` is no text.
    """
    try:
        given = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise EverystateError(f"{path} cannot be read as a config: {error}") from error
    for name in {"body", "preset"} & given.keys():
        require_kind(name, given[name], str)
    return {name: tuple(x) if isinstance(x, list) else x for name, x in given.items()}


def text(fields: Mapping[str, Any]) -> str:
    """A file with these fields: texts, numbers, truth values and lists of texts."""
    return "".join(f"{name} = {_value(x)}\n" for name, x in fields.items())


def _value(value: Any) -> str:
    if isinstance(value, float):
        return repr(value)  # JSON has no inf
    # TOML takes no halves of characters, which a file's name may have, and wants this one escaped.
    said = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return said.encode(errors="replace").decode()
