"""Ant: four legs, eight motors, and no way up that differs from the other (Zhang 2019).

An ant that lies on its back is the mirror image of one that stands, with its ankles bent the other
way: so no state is a dead end, and it need never be reset.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Shaped

from everystate.envs.joints import JointBody
from everystate.errors import EverystateError

_XML = Path(__file__).with_name("ant.xml")


@dataclass(frozen=True)
class Ant(JointBody):
    """State: height, orientation and joints of the body, and all velocities; see `JointBody`."""

    xml: Path = _XML
    frame_skip: int = 10

    name = "ant"
    source = "dm_control 1.0.50, third_party/ant/ant.xml (MIT), made symmetric"
    camera = "overview"

    # Of an ant that stands, tumbles and jumps, where under random actions it mostly lies.
    nominal: ClassVar = {
        "torso_z": (0.35, 0.15),
        "torso_v?": (0.0, 0.7),
        "torso_w?": (0.0, 2.0),
        "*_velocity": (0.0, 3.5),
    }

    def __post_init__(self) -> None:
        if not self.heading:
            raise EverystateError("the ant observes which way it faces: leave out heading=false")
        super().__post_init__()

    def initial(self, num: int, rng: np.random.Generator) -> Float[np.ndarray, "envs state"]:
        """Standing level, facing anywhere."""
        state = super().initial(num, rng)
        heading = rng.uniform(-np.pi, np.pi, num)
        cosine, sine, zero = np.cos(heading), np.sin(heading), np.zeros(num)
        columns = (cosine, sine, zero, -sine, cosine, zero)
        state[:, self._columns] = np.stack(columns, axis=1)
        return state

    def regions(self, observations: Float[np.ndarray, "*n state"]) -> Shaped[np.ndarray, "*n"]:
        """Upright, upside down or on its side, by 45 degrees, all at rest; else moving."""
        xx, xy, _, yx, yy, _ = np.moveaxis(observations[..., self._columns], -1, 0)
        up = xx * yy - xy * yx  # the height of the body's own z axis, by the cross product
        limit = np.sqrt(0.5)
        lying = np.where(up > limit, "upright", np.where(up < -limit, "upside down", "side"))
        torso, joints = np.split(np.abs(observations[..., -14:]), [6], axis=-1)
        moving = (torso.max(axis=-1) > 0.5) | (joints.max(axis=-1) > 1.0)
        return np.where(moving, "moving", lying)

    @property
    def _columns(self) -> slice:
        return self.layout.oriented[0][0]
