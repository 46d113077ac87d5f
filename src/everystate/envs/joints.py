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

from everystate.envs import rotations
from everystate.envs.body import Body
from everystate.envs.control import drive_by
from everystate.envs.ground import level
from everystate.envs.layout import Component, Layout
from everystate.envs.sensors import KINDS, sensed
from everystate.errors import EverystateError

_NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class JointBody(Body):
    """A body observed through its joints: all positions, then all velocities.

    A slide gives its position, a hinge with a range its angle, a hinge that turns right round the
    cosine and sine of it. An orientation gives the first two columns of its rotation matrix: six
    numbers without the jumps of angles or the double cover of quaternions (Zhou et al. 2019, "On
    the Continuity of Rotation Representations"). A free joint gives its height, and where it has
    got to only with `travel`: to a place without bounds nobody comes back. Velocities are
    MuJoCo's: a free joint's linear one is in the world's frame, its angular one in the body's.
    Without `heading` it gives where up is to the body (3), and both velocities in the body's frame:
    all of it is the same whichever way the body faces.
    """

    xml: Path
    frame_skip: int = 0
    """Physics steps per control step; 0 makes control steps of about `pace`."""
    travel: bool = False
    """Observe x and y of free joints, in metres from the origin."""
    sensors: bool = False
    """Observe the file's sensors too, of the kinds in `sensors.KINDS`."""
    heading: bool = True
    """Observe which way free joints face; else only where up is, and velocities in their frame."""
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
        if self.travel and not self.heading:
            raise EverystateError(
                f"{self.name or self.xml}: travel=true needs heading=true, for x and y are of the"
                " world's frame"
            )
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
        return Layout.of(self.model, travel=self.travel, sensors=self.sensors, heading=self.heading)

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

    @functools.cached_property
    def horizontal(self) -> tuple[tuple[int, int], ...]:
        """Of a free joint, if neither places nor sensors are observed, and as here."""
        kind = type(self)
        same = all(
            getattr(kind, n) is getattr(JointBody, n) for n in ("observe", "drive", "finish")
        )
        known = self.layout.horizontal and same and not (self.travel or self.sensors)
        return tuple(self.layout.horizontal) if known and level(self.model) else ()

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
            state[:, columns] = rotations.two_columns(qpos[:, quaternion])
        speeds = state[:, self.layout.velocities]
        speeds[:] = qvel
        for columns, quaternion, speed in self.layout.upright:
            state[:, columns] = rotations.up(qpos[:, quaternion])
            speeds[:, speed] = rotations.to_body(qpos[:, quaternion], qvel[:, speed])
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
            qpos[:, quaternion] = rotations.of_columns(observations[:, columns])
        qvel = np.array(observations[:, self.layout.velocities])
        for columns, quaternion, speed in self.layout.upright:
            qpos[:, quaternion] = rotations.of_up(observations[:, columns])
            qvel[:, speed] = rotations.to_world(qpos[:, quaternion], qvel[:, speed])
        return qpos, qvel

    @functools.cached_property
    def unseen(self) -> tuple[int, ...]:
        """Those of free joints, without `travel`."""
        free = np.flatnonzero(self.model.jnt_type == mjtJoint.mjJNT_FREE)
        return () if self.travel else tuple(self.model.jnt_qposadr[free].tolist())

    def carried(
        self, observations: Float[np.ndarray, "steps state"], heading: float = 0.0
    ) -> Float[np.ndarray, "steps gone"]:
        """From the velocities: between steps about the mean of both."""
        gone = np.zeros((len(observations), 3 * len(self.unseen)))
        qpos, qvel = self.place(np.asarray(observations, dtype=np.float64))
        seconds = self.model.opt.timestep * self.frame_skip
        for x, at in zip(self.unseen, range(0, gone.shape[1], 3), strict=True):
            joint = int(np.flatnonzero(self.model.jnt_qposadr == x)[0])
            dof = int(self.model.jnt_dofadr[joint])
            speeds = qvel[:, dof : dof + 3]
            if not self.heading:
                levels, spins = qpos[:, x + 3 : x + 7], qvel[:, dof + 3 : dof + 6]
                gone[:, at + 2] = heading + rotations.headings(levels, spins, seconds)
                turns = rotations.about_z(gone[:, at + 2], np.tile(_NO_TURN, (len(gone), 1)))
                speeds = rotations.to_world(turns, speeds)
            means = (speeds[1:, :2] + speeds[:-1, :2]) / 2 * seconds
            gone[1:, at : at + 2] = np.cumsum(means, axis=0)
        return gone

    def moved(
        self, qpos: Float[np.ndarray, "n nq"], gone: Float[np.ndarray, "n gone"]
    ) -> Float[np.ndarray, "n nq"]:
        """Each free joint by its x and y, and turned by its heading."""
        qpos = np.array(qpos)
        for x, at in zip(self.unseen, range(0, gone.shape[1], 3), strict=True):
            qpos[:, x : x + 2] += gone[:, at : at + 2]
            if not self.heading:
                turned = rotations.about_z(gone[:, at + 2], qpos[:, x + 3 : x + 7])
                qpos[:, x + 3 : x + 7] = turned
        return qpos

    @functools.cached_property
    def _data(self) -> mujoco.MjData:
        return mujoco.MjData(self.model)

    @functools.cached_property
    def _indices(self) -> tuple[Int[np.ndarray, "2 n"], Int[np.ndarray, "2 m"]]:
        return _transposed(self.layout.copied), _transposed(self.layout.turning)


def _transposed(pairs: list[tuple[int, int]]) -> Int[np.ndarray, "2 n"]:
    return np.array(pairs, dtype=np.intp).reshape(-1, 2).T
