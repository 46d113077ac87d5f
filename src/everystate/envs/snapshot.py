"""The state of any Python simulation as JSON: all that it takes to go on from there.

An environment is walked from its outermost wrapper inwards. Numbers, arrays, random generators and
MuJoCo's data are read wherever they hang; everything else (models, spaces, windows, functions) is
taken to be alike in all copies. Nothing is pickled, so reading a snapshot runs no code. Whether it
was enough depends on the environment: `GymnasiumVectorEnv` tries it out.
"""

import base64
import functools
import types
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np

_PHYSICS = mujoco.mjtState.mjSTATE_INTEGRATION.value
_PLAIN = (bool, int, float, str, type(None))
_DEPTH = 8
# What belongs to the making of a body or to its pictures, and dm_control's second view of its data.
_SKIPPED = {"spec", "observation_space", "action_space", "metadata", "model", "_named"}
_SKIPPED |= {"mujoco_renderer", "screen", "clock", "viewer", "render_mode", "tmp_xml_file_path"}
_CLOSED = (type, types.ModuleType, types.FunctionType, types.MethodType, mujoco.MjModel)


def take(env: Any) -> dict[str, Any]:
    """Everything in the environment that may change, by the path at which it lies."""
    return {path: value for path, value, _ in _walk(env, "", set())}


def put(env: Any, snapshot: dict[str, Any]) -> None:
    """Gives another environment of the same kind what `take` read; the inverse."""
    # The walk must be over before anything is set.
    for path, _, write in list(_walk(env, "", set())):
        if path in snapshot:
            write(snapshot[path])


def physics(env: Any) -> tuple[mujoco.MjModel, mujoco.MjData] | None:
    """The MuJoCo model and data of an environment, if it is made of such."""
    holder = env.unwrapped
    for path in ((), ("point_env",), ("ant_env", "unwrapped"), ("_env", "physics", "data")):
        inner = holder
        for name in path:
            inner = getattr(inner, name, None)
        if found := _physics_in(inner):
            return found
    return None


def _physics_in(holder: Any) -> tuple[mujoco.MjModel, mujoco.MjData] | None:
    # dm_control wraps both, and calls the wrapped one `ptr`.
    for data in (getattr(holder, "data", None), getattr(holder, "_data", None)):
        for model in (getattr(holder, "model", None), getattr(holder, "_model", None)):
            model = getattr(model, "ptr", model)
            if isinstance(data, mujoco.MjData) and isinstance(model, mujoco.MjModel):
                return model, data
    return None


def _walk(
    holder: Any, path: str, seen: set[int]
) -> Iterator[tuple[str, Any, Callable[[Any], None]]]:
    """Yields (path, value as JSON, what sets it) for all there is below an object."""
    seen.add(id(holder))
    for name, value in _parts(holder):
        here = f"{path}/{name}"
        if isinstance(value, mujoco.MjData):
            if found := _physics_in(holder):
                yield here, _read_physics(*found), functools.partial(_write_physics, *found)
        elif (coded := _encode(value)) is not None:
            yield here, coded, functools.partial(_write, holder, name, value)
        elif id(value) not in seen and here.count("/") < _DEPTH and not isinstance(value, _CLOSED):
            yield from _walk(value, here, seen)


def _parts(holder: Any) -> list[tuple[Any, Any]]:
    if isinstance(holder, dict):
        return [(k, v) for k, v in holder.items() if isinstance(k, (str, int))]
    if isinstance(holder, (list, tuple)):
        return list(enumerate(holder))
    found = getattr(holder, "__dict__", {})
    return [(k, v) for k, v in found.items() if k not in _SKIPPED]


def _encode(value: Any) -> Any:
    """A value as JSON, or None for what is to be walked into or left alone."""
    if isinstance(value, _PLAIN):
        return {"plain": value}
    if isinstance(value, np.random.Generator):
        return (
            {"generator": value.bit_generator.state} if _plain(value.bit_generator.state) else None
        )
    if isinstance(value, np.random.RandomState):
        kind, keys, *rest = value.get_state()
        return {"random_state": [kind, np.asarray(keys).tolist(), *rest]}
    if isinstance(value, (np.ndarray, np.generic)) and value.dtype.kind in "biufc":
        data = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode()
        return {"array": [value.dtype.str, list(value.shape), data, isinstance(value, np.generic)]}
    if isinstance(value, (list, dict, tuple)) and _plain(value):
        return {type(value).__name__: value} if type(value) in (list, dict, tuple) else None
    return None


def _decode(coded: dict[str, Any]) -> Any:
    (kind, value), *_ = coded.items()
    if kind == "array":
        dtype, shape, data, scalar = value
        array = np.frombuffer(base64.b64decode(data), dtype=dtype).reshape(shape).copy()
        return array[()] if scalar else array
    return tuple(value) if kind == "tuple" else value


def _plain(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return all(_plain(x) for x in value)
    if isinstance(value, dict):
        return all(isinstance(k, str) and _plain(x) for k, x in value.items())
    return isinstance(value, _PLAIN)


def _write(holder: Any, name: Any, present: Any, coded: dict[str, Any]) -> None:
    if "generator" in coded:
        present.bit_generator.state = coded["generator"]
        return
    if "random_state" in coded:
        present.set_state(tuple(coded["random_state"]))
        return
    value = _decode(coded)
    alike = isinstance(present, np.ndarray) and isinstance(value, np.ndarray)
    if alike and present.shape == value.shape and present.flags.writeable:
        present[...] = value  # in place: it may be a view of something else
    elif isinstance(holder, (dict, list)):
        holder[name] = value
    elif not isinstance(holder, tuple):
        holder.__dict__[name] = value


def _read_physics(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, Any]:
    state = np.empty(mujoco.mj_stateSize(model, _PHYSICS))
    mujoco.mj_getState(model, data, state, _PHYSICS)
    return _encode(state)


def _write_physics(model: mujoco.MjModel, data: mujoco.MjData, coded: dict[str, Any]) -> None:
    state = _decode(coded)
    mujoco.mj_setState(model, data, state, _PHYSICS)
    mujoco.mj_forward(model, data)  # what follows from the state, which some steps begin with
    mujoco.mj_setState(model, data, state, _PHYSICS)
