"""Bodies: what learns, each a MuJoCo model stepped many at a time."""

import dataclasses
from typing import Any

import gymnasium

from everystate.envs.body import Body
from everystate.envs.mujoco_vector import MujocoVectorEnv
from everystate.envs.ramp_pointmass import RampPointmass
from everystate.errors import EverystateError, suggest

__all__ = ["BODIES", "Body", "MujocoVectorEnv", "RampPointmass", "make"]

_BODIES: dict[str, type[Body]] = {"ramp-pointmass": RampPointmass}

BODIES = tuple(_BODIES)


def make(body: str, num_envs: int, seed: int | None, **options: Any) -> MujocoVectorEnv:
    """Builds `num_envs` bodies; options are those of the body, `num_threads` and `render_mode`."""
    if body not in _BODIES:
        raise EverystateError(f"unknown body {body!r}: {suggest(body, BODIES)}")
    own = {f.name for f in dataclasses.fields(_BODIES[body])}
    stepper = {"num_threads", "render_mode"}
    for name in options.keys() - own - stepper:
        raise EverystateError(f"{body} has no option {name!r}: {suggest(name, own | stepper)}")
    built = _BODIES[body](**{name: options[name] for name in options.keys() & own})
    rest = {name: options[name] for name in options.keys() & stepper}
    return MujocoVectorEnv(built, num_envs, seed, **rest)


for _name, _class in _BODIES.items():
    gymnasium.register(
        id=f"everystate/{_class.__name__}-v0",
        entry_point="everystate.envs.registered:SingleEnv",
        vector_entry_point="everystate.envs.registered:vector_env",
        kwargs={"body": _name},
    )
