"""Bodies: what learns, each a MuJoCo model stepped many at a time."""

from typing import Any

from everystate.envs.body import Body
from everystate.envs.mujoco_vector import MujocoVectorEnv
from everystate.envs.ramp_pointmass import RampPointmass
from everystate.errors import EverystateError, suggest

__all__ = ["BODIES", "Body", "MujocoVectorEnv", "RampPointmass", "make"]

_BODIES: dict[str, type[Body]] = {"ramp-pointmass": RampPointmass}

BODIES = tuple(_BODIES)


def make(body: str, num_envs: int, seed: int, **options: Any) -> MujocoVectorEnv:
    """Builds `num_envs` bodies; options are those of the body, `num_threads` and `render_mode`."""
    if body not in _BODIES:
        raise EverystateError(f"unknown body {body!r}: {suggest(body, BODIES)}")
    stepper = {name: options.pop(name) for name in ("num_threads", "render_mode") if name in options}
    return MujocoVectorEnv(_BODIES[body](**options), num_envs, seed, **stepper)
