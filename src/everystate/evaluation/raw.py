"""Raw results: written once by the program that measured, and never edited after."""

import hashlib
import json
import os
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from everystate.errors import EverystateError
from everystate.evaluation.provenance import provenance

HEADER = ("command", "argv", "commit", "clean", "machine", "versions", "date")
"""Fields that `write` adds where the result has none of its own."""
LARGEST = 1_000_000
"""Bytes: what is kept in git is small columns, not everything that was seen."""


def write(
    path: Path | str, result: Mapping[str, Any], *, replace: bool = False, largest: int = LARGEST
) -> None:
    """Writes a result as JSON, a line for each field, with where it comes from and its hash.

    A file that holds the same result already is left as it is. The file is there whole or not at
    all.

    Args:
        path: of the file; folders are created.
        result: what was measured, as JSON has it; fields of `HEADER` in it are kept.
        replace: overwrite a file that holds another result.
        largest: bytes that it may have.

    Raises:
        EverystateError: the result is no JSON, or larger than `largest`, or the file holds another.
    """
    path = Path(path)
    try:
        content: dict[str, Any] = json.loads(json.dumps(dict(result), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise EverystateError(f"{path}: the result is no JSON ({error})") from None
    content = {name: x for name, x in content.items() if name != "sha256"}
    if path.exists() and not replace:
        found = _read(path)
        if _signed(found) == found and _measured(found) == _measured(content):
            return
        raise EverystateError(
            f"{path} holds another result: choose another file, or say that it is to be replaced"
        )
    header = {**provenance(), "date": datetime.now(UTC).isoformat(timespec="seconds")}
    content |= {name: x for name, x in header.items() if name not in content}
    lines = (f" {json.dumps(n)}: {json.dumps(x)}" for n, x in _signed(content).items())
    text = "{\n" + ",\n".join(lines) + "\n}\n"
    if len(text) > largest:
        raise EverystateError(
            f"{path} would have {len(text):,} bytes, at most {largest:,} are kept: write fewer"
            " columns, or less of each"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.draft")
    draft.write_text(text)
    os.replace(draft, path)


def check(path: Path | str) -> dict[str, Any]:
    """The content of a raw result, if it is as its program wrote it.

    Raises:
        EverystateError: a field is missing, the command is empty, or the hash is of other content.
    """
    content = _read(Path(path))
    missing = [name for name in (*HEADER, "sha256") if name not in content]
    if missing or not content["command"] or not content["argv"]:
        lacks = ", ".join(missing or ["a command"])
        raise EverystateError(f"{path} lacks {lacks}: write it by everystate.evaluation.raw")
    if _signed(content)["sha256"] != content["sha256"]:
        raise EverystateError(
            f"{path} was changed after it was written: make it again or delete it"
        )
    return content


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _measured(content: Mapping[str, Any]) -> dict[str, Any]:
    return {n: x for n, x in content.items() if n not in (*HEADER, "sha256")}


def _signed(content: Mapping[str, Any]) -> dict[str, Any]:
    unsigned = {name: x for name, x in content.items() if name != "sha256"}
    canonical = json.dumps(unsigned, sort_keys=True, separators=(",", ":"))
    return unsigned | {"sha256": hashlib.sha256(canonical.encode()).hexdigest()}
