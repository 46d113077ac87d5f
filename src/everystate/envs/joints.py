"""Bodies whose state is that of their joints: any MJCF file, and what ours have in common."""

import fnmatch
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import mujoco
import numpy as np
from jaxtyping import Float, Int
from mujoco import mjtJoint

from everystate.envs.body import Body
from everystate.envs.control import drive_by
from everystate.envs.layout import Component, Layout
from everystate.envs.sensors import KINDS, sensed
from everystate.errors import EverystateError


@dataclass(frozen=True)
class JointBody(Body):
    """A body observed through its joints: all positions, then all velocities.

    A slide gives its position, a hinge with a range its angle, a hinge that turns right round the
    cosine and sine of it. An orientation gives the first two columns of its rotation matrix: six
    numbers without the jumps of angles or the double cover of quaternions (Zhou et al. 2019, "On
    the Continuity of Rotation Representations"). A free joint gives its height, and where it has
    got to only with `travel`: to a place without bounds nobody comes back. Velocities are
    MuJoCo's: a free joint's linear one is in the world's frame, its angular one in the body's.
    """

    xml: Path
    frame_skip: int = 0
    """Physics steps per control step; 0 makes control steps of about `pace`."""
    travel: bool = False
    """Observe x and y of free joints, in metres from the origin."""
    sensors: bool = False
    """Observe the file's sensors too, of the kinds in `sensors.KINDS`."""
    control: str = ""
    """torque: actions are torques; position: targets of the joints; by default as in the file."""

    name = ""  # if it has none of its own, the path of the file as it was given
    source = "your own file"
    nominal: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Centre and spread of components by the pattern of their names, where one knows better."""
    pace: ClassVar[float] = 0.04
    """Seconds, about, of a control step where no `frame_skip` is given."""

    def __post_init__(self) -> None:
        if not 0 <= self.frame_skip <= 1000:
            raise EverystateError(f"frame_skip is {self.frame_skip}: choose 1 to 1000")
        if self.frame_skip == 0:
            skip = max(1, round(self.pace / self.model.opt.timestep))
            object.__setattr__(self, "frame_skip", skip)
        if not self.name:
            object.__setattr__(self, "name", str(self.xml))
        if self.sensors and not self.layout.sensed:
            raise EverystateError(
                f"{self.name} has no sensor that can be observed: leave out sensors=true, or add"
                f" one of these kinds: {', '.join(KINDS)}"
            )

    def load(self) -> mujoco.MjModel:
        """The model in the file, its motors driven as `control` says."""
        model = super().load()
        if self.control:
            drive_by(model, self.control)
        return model

    @functools.cached_property
    def model(self) -> mujoco.MjModel:
        """What `load` gives."""
        return self.load()

    @functools.cached_property
    def layout(self) -> Layout:
        """How a state is read off the physics."""
        return Layout.of(self.model, travel=self.travel, sensors=self.sensors)

    @functools.cached_property
    def state_names(self) -> tuple[str, ...]:
        """After the joints and sensors, as named in the file."""
        return tuple(c.name for c in self.layout.components)

    @functools.cached_property
    def state_units(self) -> tuple[str, ...]:
        """Metres, radians, seconds; 1 where there is no unit."""
        return tuple(c.unit for c in self.layout.components)

    @functools.cached_property
    def centre(self) -> tuple[float, ...]:
        """Nominal, or the middle of the range; NaN without either."""
        return tuple(self._nominal(c)[0] for c in self.layout.components)

    @functools.cached_property
    def spread(self) -> tuple[float, ...]:
        """Nominal, or as if uniform over the range; NaN without either."""
        return tuple(self._nominal(c)[1] for c in self.layout.components)

    @functools.cached_property
    def high(self) -> tuple[float, ...]:
        """Only of cosines and the like: joints give way at their limits."""
        return tuple(c.bound for c in self.layout.components)

    @functools.cached_property
    def low(self) -> tuple[float, ...]:
        """See `high`."""
        return tuple(-c.bound for c in self.layout.components)

    def _nominal(self, component: Component) -> tuple[float, float]:
        for pattern, values in self.nominal.items():
            if fnmatch.fnmatchcase(component.name, pattern):
                return values
        return component.centre, component.spread

    def initial(self, num: int, rng: np.random.Generator) -> Float[np.ndarray, "envs state"]:
        """In the file's first keyframe, or else as it was drawn; nudged, no two bodies alike."""
        model = self.model
        pose = model.key_qpos[0] if model.nkey else model.qpos0
        return self.observe(np.tile(pose, (num, 1)), rng.normal(0.0, 0.05, (num, model.nv)))

    def observe(
        self, qpos: Float[np.ndarray, "envs nq"], qvel: Float[np.ndarray, "envs nv"]
    ) -> Float[np.ndarray, "envs state"]:
        """Positions and velocities of the joints, and then what the sensors say."""
        copied, turning = self._indices
        state = np.empty((len(qpos), len(self.layout.components)))
        state[:, copied[0]] = qpos[:, copied[1]]
        if turning.size:
            angles = qpos[:, turning[1]]
            state[:, turning[0]] = np.cos(angles)
            state[:, turning[0] + 1] = np.sin(angles)
        for columns, quaternion in self.layout.oriented:
            state[:, columns] = _two_columns(qpos[:, quaternion])
        state[:, self.layout.velocities] = qvel
        if at := self.layout.sensed:
            found = sensed(self.model, self._data, qpos, qvel)
            state[:, self.layout.velocities.stop :] = found[:, at]
        return state

    def place(
        self, observations: Float[np.ndarray, "envs state"]
    ) -> tuple[Float[np.ndarray, "envs nq"], Float[np.ndarray, "envs nv"]]:
        """The joints as observed, made a true orientation; x and y as in the file if unseen."""
        copied, turning = self._indices
        qpos = np.tile(self.model.qpos0, (len(observations), 1))
        qpos[:, copied[1]] = observations[:, copied[0]]
        if turning.size:
            sines, cosines = observations[:, turning[0] + 1], observations[:, turning[0]]
            qpos[:, turning[1]] = np.arctan2(sines, cosines)
        for columns, quaternion in self.layout.oriented:
            qpos[:, quaternion] = _quaternions(observations[:, columns])
        return qpos, np.array(observations[:, self.layout.velocities])

    @functools.cached_property
    def unseen(self) -> tuple[int, ...]:
        """Those of free joints, without `travel`."""
        free = np.flatnonzero(self.model.jnt_type == mjtJoint.mjJNT_FREE)
        return () if self.travel else tuple(self.model.jnt_qposadr[free].tolist())

    def carried(
        self, observations: Float[np.ndarray, "steps state"]
    ) -> Float[np.ndarray, "steps nq"]:
        """x and y of free joints, from their velocities: between steps about the mean of both."""
        moved = np.zeros((len(observations), self.model.nq))
        velocities = np.asarray(observations, dtype=np.float64)[:, self.layout.velocities]
        means = (velocities[1:] + velocities[:-1]) / 2 * self.model.opt.timestep * self.frame_skip
        for x in self.unseen:
            joint = int(np.flatnonzero(self.model.jnt_qposadr == x)[0])
            dof = int(self.model.jnt_dofadr[joint])
            moved[1:, x : x + 2] = np.cumsum(means[:, dof : dof + 2], axis=0)
        return moved

    @functools.cached_property
    def _data(self) -> mujoco.MjData:
        return mujoco.MjData(self.model)

    @functools.cached_property
    def _indices(self) -> tuple[Int[np.ndarray, "2 n"], Int[np.ndarray, "2 m"]]:
        return _transposed(self.layout.copied), _transposed(self.layout.turning)


def _transposed(pairs: list[tuple[int, int]]) -> Int[np.ndarray, "2 n"]:
    return np.array(pairs, dtype=np.intp).reshape(-1, 2).T


def _two_columns(quaternions: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 6"]:
    """The first two columns of the rotation matrices of unit quaternions (w, x, y, z)."""
    w, x, y, z = quaternions.T
    columns = np.empty((len(quaternions), 6))
    columns[:, 0] = 1 - 2 * (y * y + z * z)
    columns[:, 1] = 2 * (x * y + w * z)
    columns[:, 2] = 2 * (x * z - w * y)
    columns[:, 3] = 2 * (x * y - w * z)
    columns[:, 4] = 1 - 2 * (x * x + z * z)
    columns[:, 5] = 2 * (y * z + w * x)
    return columns


def _quaternions(columns: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 4"]:
    """The rotations whose matrices have nearly these two columns, by Gram and Schmidt."""
    first = _unit(columns[:, :3], [1.0, 0.0, 0.0])
    along = (columns[:, 3:] * first).sum(axis=1, keepdims=True)
    # Where the second is no direction of its own, any that stands on the first will do.
    spare = np.roll(first, 1, axis=1)
    spare -= (spare * first).sum(axis=1, keepdims=True) * first
    second = _unit(columns[:, 3:] - along * first, spare)
    matrices = np.stack([first, second, np.cross(first, second)], axis=-1)
    from scipy.spatial.transform import Rotation  # which takes long to import

    return Rotation.from_matrix(matrices).as_quat(canonical=True, scalar_first=True)


def _unit(vectors: Float[np.ndarray, "n 3"], otherwise) -> Float[np.ndarray, "n 3"]:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    vectors = np.where(lengths > 1e-6, vectors, otherwise)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
