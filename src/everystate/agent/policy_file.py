"""A policy as one file, for programs without JAX: NAME.onnx, or NAME.npz for NumPy."""

import contextlib
import difflib
import io
import json
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from everystate.agent import sharing
from everystate.errors import EverystateError
from everystate.portable import DESCRIPTION, FORMAT, INPUTS, OUTPUT, Policy

_OPSET, _IR = 16, 8
"""Of ONNX: not the newest, for older runtimes."""
_ATTRIBUTES: dict[str, dict[str, Any]] = {"Concat": {"axis": 1}}


def is_one(path: Path) -> bool:
    """Whether a name is that of a policy's file.

    Raises:
        EverystateError: it is nearly that of some file, and hardly that of a folder.
    """
    near = difflib.get_close_matches(path.suffix.lower(), (sharing.ARCHIVE, *FORMS), n=1)
    if near and near[0] != path.suffix:
        raise EverystateError(f"{path} ends in {path.suffix}: did you mean {near[0]}?")
    return path.suffix in FORMS


def require_nothing_else(path: Path, scores: Mapping[str, Any] | None, half: bool) -> None:
    """Raises if more is asked for than such a file holds."""
    if scores or half:
        raise EverystateError(
            f"{path} holds the policy alone, in full: leave out scores and half, or export to a"
            " folder or NAME.zip"
        )


def refuse(path: Path) -> None:
    """Raises if a file holds a policy where an agent is asked for."""
    if path.suffix in FORMS:
        raise EverystateError(
            f"{path} holds a policy alone: everystate.portable.load reads an .npz, ONNX Runtime"
            " an .onnx; give a run folder or an exported agent"
        )


def write(path: Path, policy: Policy) -> Path:
    """Writes the file that the name's ending says, which must not exist; whole or not at all.

    Raises:
        EverystateError: it exists, cannot be written, or needs the package `onnx`.
    """
    if path.exists():
        raise EverystateError(f"{path} exists already: export to another place")
    content = FORMS[path.suffix](policy)
    draft = path.with_name(f".{path.name}.draft")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_bytes(content)
        draft.rename(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise EverystateError(f"cannot export to {path}: {error.strerror}") from error
    return path


def _npz(policy: Policy) -> bytes:
    told = {
        "format": FORMAT,
        "everystate": version("everystate"),
        "state_names": policy.state_names,
        "action_names": policy.action_names,
        "steps": policy.steps,
    }
    file = io.BytesIO()
    arrays: dict[str, Any] = {DESCRIPTION: np.array(json.dumps(told)), **policy.constants}
    np.savez(file, **arrays)
    return file.getvalue()


def _onnx(policy: Policy) -> bytes:
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ImportError as error:
        raise EverystateError(
            "an .onnx file needs the package onnx: pip install 'everystate[onnx]', or export to"
            " NAME.npz, which NumPy runs"
        ) from error

    def tensor(name: str, size: int) -> onnx.ValueInfoProto:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", size])

    graph = helper.make_graph(
        [
            helper.make_node(operator, inputs, [output], **_ATTRIBUTES.get(operator, {}))
            for operator, inputs, output in policy.steps
        ],
        "policy",
        [tensor(name, len(policy.state_names)) for name in INPUTS],
        [tensor(OUTPUT, len(policy.action_names))],
        [numpy_helper.from_array(array, name) for name, array in policy.constants.items()],
    )
    model = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", _OPSET)],
        ir_version=_IR,
        producer_name="everystate",
        producer_version=version("everystate"),
    )
    names = {"state_names": policy.state_names, "action_names": policy.action_names}
    helper.set_model_props(model, {name: json.dumps(x) for name, x in names.items()})
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


FORMS: dict[str, Callable[[Policy], bytes]] = {".npz": _npz, ".onnx": _onnx}
"""The content of a file by how its name ends."""
