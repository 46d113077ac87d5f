"""Bodies: what learns, many at a time."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from typing import Any

import gymnasium

from everystate.config import MODEL_COPY
from everystate.envs.adapt import import_module, name_of
from everystate.envs.ant import Ant
from everystate.envs.body import Body
from everystate.envs.cartpole import Cartpole
from everystate.envs.description import description, headline
from everystate.envs.disturbance import Disturbance
from everystate.envs.gymnasium_vector import GymnasiumVectorEnv
from everystate.envs.joints import JointBody
from everystate.envs.model_copy import copied_model, copy_model
from everystate.envs.mujoco_vector import MujocoVectorEnv
from everystate.envs.ramp_pointmass import RampPointmass
from everystate.envs.robots import PREFIX, ROBOTS, RobotBody, list_robots
from everystate.envs.vector import BodyVectorEnv, Physics, random_play
from everystate.errors import EverystateError, suggest

__all__ = [
    "BODIES",
    "ROBOTS",
    "Ant",
    "Body",
    "BodyVectorEnv",
    "Cartpole",
    "Disturbance",
    "GymnasiumVectorEnv",
    "JointBody",
    "MujocoVectorEnv",
    "Physics",
    "RampPointmass",
    "body_of",
    "copy_model",
    "describe",
    "headline",
    "list_robots",
    "make",
    "own_model",
    "parse_options",
    "random_play",
    "versions",
]

_BODIES: dict[str, type[Body]] = {
    "ramp-pointmass": RampPointmass,
    "cartpole": Cartpole,
    "ant": Ant,
}
_DISTURBANCE = tuple(field.name for field in dataclasses.fields(Disturbance))

BODIES = tuple(_BODIES)


def make(body: str, num_envs: int, seed: int | None = None, **options: Any) -> BodyVectorEnv:
    """Builds many copies of a body.

    Args:
        body: one of `BODIES`; the path of an MJCF file, NAME.xml; `robot:NAME`, one of `ROBOTS`;
            or `module:id`, where the id is one that the module registers with Gymnasium, or the
            name of a `Body` class in it, or of a function or class there that makes a Gymnasium
            environment.
        num_envs: how many.
        seed: of everything random in them; None makes a different run each time.
        **options: fields of the body's class or arguments of the Gymnasium environment; those of
            `Disturbance`; `num_threads` (MuJoCo bodies), `ends` (Gymnasium ids), `render_mode`;
            and `model_copy`, a folder with the copy of the model that a run or an agent has.

    Raises:
        EverystateError: no such body or option, a model that does not compile, spaces that cannot
            be learned, or a package that is not installed.
    """
    disturbed = {name: options.pop(name) for name in _DISTURBANCE if name in options}
    kind: type[Body] | None = _BODIES.get(body)
    if kind is None and body.endswith(".xml"):
        kind, options = JointBody, {"xml": Path(body), **options}
    elif kind is None and body.startswith(PREFIX):
        kind, options = RobotBody, {**options, "robot": body.removeprefix(PREFIX)}
    elif kind is None and ":" in body:
        module, _, name = body.partition(":")
        found = getattr(import_module(module, body), name, None)
        if not (isinstance(found, type) and issubclass(found, Body)):
            return GymnasiumVectorEnv(
                body, num_envs, seed, disturbance=_built(Disturbance, body, disturbed), **options
            )
        kind = found
    elif kind is None:
        raise EverystateError(
            f"unknown body {body!r}: {suggest(body, BODIES)}, the path of an MJCF file ending in"
            " .xml, robot:NAME or gymnasium:ID"
        )
    if MODEL_COPY in options:
        options["xml"] = copied_model(Path(str(options.pop(MODEL_COPY))))
    stepper = {k: options.pop(k) for k in ("num_threads", "render_mode") if k in options}
    known = {f.name for f in dataclasses.fields(kind)}  # pyright: ignore[reportArgumentType]
    for name in options.keys() - known:
        choices = known | {"num_threads", "render_mode", *_DISTURBANCE}
        raise EverystateError(f"{body} has no option {name!r}: {suggest(name, choices)}")
    built = _built(kind, body, options)
    if getattr(kind, "name", None) == "":
        object.__setattr__(built, "name", body)  # wherever a copy of its file lies
    return MujocoVectorEnv(
        built,
        num_envs,
        seed,
        disturbance=_built(Disturbance, body, disturbed),
        **stepper,
    )


def body_of(factory: Callable[..., Any]) -> str:
    """The name by which `make` finds a `Body` class, or what makes a Gymnasium environment.

    Raises:
        EverystateError: another process would not find it.
    """
    built_in = (name for name, kind in _BODIES.items() if kind is factory)
    return next(built_in, None) or name_of(factory)


def own_model(env: BodyVectorEnv) -> Path | None:
    """The model file of a body, if it is its user's own or a robot's, and no part of ours."""
    if not isinstance(env, MujocoVectorEnv) or type(env.body) in _BODIES.values():
        return None
    has_option = any(f.name == "xml" for f in dataclasses.fields(env.body))  # pyright: ignore
    return env.body.xml if has_option else None


def describe(env: BodyVectorEnv) -> str:
    """What a body is, in lines for people; see `description`."""
    return description(env, own_model(env))


@functools.cache
def versions(body: str) -> dict[str, str]:
    """Of the packages that a body comes from."""
    found = {"mujoco": version("mujoco")}
    if ":" in body and not body.startswith(PREFIX):
        module = body.partition(":")[0].partition(".")[0]
        for name in ("gymnasium", *packages_distributions().get(module, ())):
            try:
                found[name] = version(name)
            except PackageNotFoundError:
                continue
    return found


def parse_options(options: Sequence[str]) -> dict[str, Any]:
    """What `name=value` strings say: numbers, true and false, or else text."""
    parsed: dict[str, Any] = {}
    for option in options:
        name, sign, text = option.partition("=")
        if not (name.isidentifier() and sign):
            raise EverystateError(f"body option {option!r}: give name=value, as in travel=true")
        parsed[name] = _value(text)
    return parsed


def _value(text: str) -> bool | int | float | str:
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _built(kind: type, body: str, options: dict[str, Any]) -> Any:
    """The dataclass, or an error that names the option whose value is of a wrong kind."""
    for field in dataclasses.fields(kind):
        accepted = _KINDS.get(field.type)
        if accepted is None or field.name not in options:
            continue
        value = options[field.name]
        if not isinstance(value, accepted) or (isinstance(value, bool) and bool not in accepted):
            raise EverystateError(
                f"{body}: option {field.name} is {value!r}: expected {accepted[-1].__name__}"
            )
    return kind(**options)


_KINDS: dict[Any, tuple[type, ...]] = {float: (int, float), int: (int,), bool: (bool,)}

for _name, _class in _BODIES.items():
    gymnasium.register(
        id=f"everystate/{_class.__name__}-v0",
        entry_point="everystate.envs.registered:SingleEnv",
        vector_entry_point="everystate.envs.registered:vector_env",
        kwargs={"body": _name},
    )
