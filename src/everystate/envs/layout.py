"""Which numbers a state of joints consists of, and where in the physics each lies."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import mujoco
from mujoco import mjtJoint

from everystate.envs.sensors import readings

_UNIFORM = 1 / math.sqrt(3)  # standard deviation of a uniform variable on [-1, 1]


class Component(NamedTuple):
    """One number of the state."""

    name: str
    unit: str
    centre: float = 0.0
    spread: float = math.nan
    bound: float = math.inf


@dataclass
class Layout:
    """The components of a model's state, and where in qpos each lies."""

    components: list[Component] = field(default_factory=list)
    copied: list[tuple[int, int]] = field(default_factory=list)
    """Pairs of an index of the state and one of qpos, which are equal."""
    turning: list[tuple[int, int]] = field(default_factory=list)
    """The same of a cosine, before its sine, and its angle."""
    oriented: list[tuple[slice, slice]] = field(default_factory=list)
    """The same of two columns of a rotation matrix and their quaternion."""
    upright: list[tuple[slice, slice, slice]] = field(default_factory=list)
    """The same of where up is, the quaternion, and the linear velocity in the body's frame."""
    horizontal: list[tuple[int, int]] = field(default_factory=list)
    """Where x and y lie of free joints' axes, and of their velocities in the world's frame."""
    velocities: slice = field(default_factory=lambda: slice(0))
    """Where in the state they lie."""
    sensed: list[int] = field(default_factory=list)
    """Where in `sensordata` the last components lie."""

    @classmethod
    def of(cls, model: mujoco.MjModel, *, travel: bool, sensors: bool, heading: bool) -> "Layout":
        """All positions, all velocities, then sensors; `JointBody` says of what."""
        layout, names = cls(), _names(model)
        for joint, name in enumerate(names):
            layout._pose(model, joint, name, travel=travel, heading=heading)
        begin = len(layout.components)
        for joint, name in enumerate(names):
            layout._velocity(model, joint, name)
        layout.velocities = slice(begin, len(layout.components))
        known = {component.name for component in layout.components}
        for name, unit, at in readings(model) if sensors else ():
            name = f"sensor_{name}" if name in known else name
            layout.components.append(Component(name, unit, math.nan))
            layout.sensed.append(at)
        return layout

    def _pose(
        self, model: mujoco.MjModel, joint: int, name: str, *, travel: bool, heading: bool
    ) -> None:
        kind = mjtJoint(model.jnt_type[joint])
        at = int(model.jnt_qposadr[joint])
        low, high = model.jnt_range[joint].tolist()
        limited = bool(model.jnt_limited[joint])
        if kind in (mjtJoint.mjJNT_FREE, mjtJoint.mjJNT_BALL):
            if kind == mjtJoint.mjJNT_FREE:
                for axis in range(0 if travel else 2, 3):
                    self._copy(at + axis, Component(f"{name}_{'xyz'[axis]}", "m", math.nan))
                at += 3
            size = len(self.components)
            if kind == mjtJoint.mjJNT_FREE and not heading:
                dof = int(model.jnt_dofadr[joint])
                self.upright.append((slice(size, size + 3), slice(at, at + 4), slice(dof, dof + 3)))
                names = [f"{name}_up{axis}" for axis in "xyz"]
                self.components += [Component(n, "1", 0.0, _UNIFORM, 1.0) for n in names]
                return
            self.oriented.append((slice(size, size + 6), slice(at, at + 4)))
            if kind == mjtJoint.mjJNT_FREE:
                self.horizontal += [(size, size + 1), (size + 3, size + 4)]
            names = [f"{name}_{column}{axis}" for column in "xy" for axis in "xyz"]
            self.components += [Component(n, "1", 0.0, _UNIFORM, 1.0) for n in names]
        elif kind == mjtJoint.mjJNT_HINGE and not (limited and high - low < 2 * math.pi):
            self.turning.append((len(self.components), at))
            names = (f"cos_{name}", f"sin_{name}")
            self.components += [Component(n, "1", 0.0, math.sqrt(0.5), 1.0) for n in names]
        else:
            unit = "m" if kind == mjtJoint.mjJNT_SLIDE else "rad"
            nominal = ((low + high) / 2, (high - low) / 2 * _UNIFORM) if limited else (math.nan,)
            self._copy(at, Component(name, unit, *nominal))

    def _copy(self, at: int, component: Component) -> None:
        self.copied.append((len(self.components), at))
        self.components.append(component)

    def _velocity(self, model: mujoco.MjModel, joint: int, name: str) -> None:
        kind = mjtJoint(model.jnt_type[joint])
        if kind in (mjtJoint.mjJNT_FREE, mjtJoint.mjJNT_BALL):
            if kind == mjtJoint.mjJNT_FREE:
                if self.horizontal:
                    self.horizontal.append((len(self.components), len(self.components) + 1))
                self.components += [Component(f"{name}_v{axis}", "m/s") for axis in "xyz"]
            self.components += [Component(f"{name}_w{axis}", "rad/s") for axis in "xyz"]
        else:
            unit = "m/s" if kind == mjtJoint.mjJNT_SLIDE else "rad/s"
            self.components.append(Component(f"{name}_velocity", unit))


def _names(model: mujoco.MjModel) -> list[str]:
    """Of the joints: as in the file, or that of the body that is a joint's own, or by number."""
    names = [model.joint(i).name for i in range(model.njnt)]
    for i, body in enumerate(model.jnt_bodyid):
        name = model.body(body).name
        fit = name and model.body_jntnum[body] == 1 and name not in names
        names[i] = names[i] or (name if fit else f"joint{i}")
    return names
