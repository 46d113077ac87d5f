"""What an action is to a motor: a torque, or a target that the motor pulls its joint to."""

import math

import mujoco
import numpy as np
from jaxtyping import Float

from everystate.errors import EverystateError

CONTROLS = ("torque", "position")
_GIVE = 1.0
"""Radians (or metres) from its target at which a motor gives all of its force."""
_DAMPING = 0.02
"""Seconds: a joint at this times a speed from its target is slowed as if it were there already."""


def drive_by(model: mujoco.MjModel, by: str) -> None:
    """Makes every motor of a model one whose signal is a torque, or one whose signal is a target.

    Torques range over what the motor can give. Targets range over the range of the joint (or over
    one turn); a motor that had none before pulls with all of its force from a radian away, and
    damps as a servo does. Motors that are so already stay as they are.

    Args:
        model: is changed.
        by: one of `CONTROLS`.

    Raises:
        EverystateError: another word, or a motor that cannot be driven so.
    """
    if by not in CONTROLS:
        raise EverystateError(f"control is {by!r}: choose {' or '.join(CONTROLS)}")
    for motor in range(model.nu):
        if by == ("position" if model.actuator_biastype[motor] else "torque"):
            continue
        most = _force(model, motor)
        if _is_muscle(model, motor) or not (most > 0).all():
            raise EverystateError(
                f"motor {_name(model, motor)} cannot be driven by {by}: it must be a <motor> with"
                " a ctrlrange or forcerange, or a <position> with a forcerange"
            )
        {"torque": _push, "position": _pull}[by](model, motor, most)


def _force(model: mujoco.MjModel, motor: int) -> Float[np.ndarray, " 2"]:
    """The most that a motor can give down and up its joint or tendon; 0 if nothing bounds it."""
    gear = abs(model.actuator_gear[motor, 0])
    bounds = []
    if model.actuator_forcelimited[motor]:
        bounds.append(gear * model.actuator_forcerange[motor])
    if model.actuator_ctrllimited[motor] and not model.actuator_biastype[motor]:
        gain = abs(model.actuator_gainprm[motor, 0])
        bounds.append(gear * gain * model.actuator_ctrlrange[motor])
    joint = model.actuator_trnid[motor, 0]
    if _on_joint(model, motor) and model.jnt_actfrclimited[joint]:
        bounds.append(model.jnt_actfrcrange[joint])
    low, high = np.array(bounds or [[0.0, 0.0]]).T
    return np.array([-low.max(), high.min()])


def _push(model: mujoco.MjModel, motor: int, most: Float[np.ndarray, " 2"]) -> None:
    model.actuator_biastype[motor] = mujoco.mjtBias.mjBIAS_NONE
    model.actuator_biasprm[motor] = 0.0
    model.actuator_gainprm[motor, :3] = 1.0, 0.0, 0.0
    model.actuator_gear[motor, 0] = 1.0
    model.actuator_forcelimited[motor] = False
    model.actuator_ctrllimited[motor] = True
    model.actuator_ctrlrange[motor] = -most[0], most[1]


def _pull(model: mujoco.MjModel, motor: int, most: Float[np.ndarray, " 2"]) -> None:
    joint = model.actuator_trnid[motor, 0]
    turns = mujoco.mjtJoint.mjJNT_HINGE
    limited = _on_joint(model, motor) and model.jnt_limited[joint]
    if not limited and not (_on_joint(model, motor) and model.jnt_type[joint] == turns):
        raise EverystateError(
            f"motor {_name(model, motor)} cannot be driven by position: it moves no hinge and no"
            " joint with a range"
        )
    stiffness = most.min() / _GIVE
    model.actuator_biastype[motor] = mujoco.mjtBias.mjBIAS_AFFINE
    model.actuator_biasprm[motor, :3] = 0.0, -stiffness, -stiffness * _DAMPING
    model.actuator_gainprm[motor, :3] = stiffness, 0.0, 0.0
    model.actuator_gear[motor, 0] = 1.0
    model.actuator_forcelimited[motor] = True
    model.actuator_forcerange[motor] = -most[0], most[1]
    model.actuator_ctrllimited[motor] = True
    ends = model.jnt_range[joint] if limited else (-math.pi, math.pi)
    model.actuator_ctrlrange[motor] = ends


def _is_muscle(model: mujoco.MjModel, motor: int) -> bool:
    """Or another motor with a state or law of its own."""
    plain = (
        (model.actuator_dyntype[motor], (mujoco.mjtDyn.mjDYN_NONE,)),
        (model.actuator_gaintype[motor], (mujoco.mjtGain.mjGAIN_FIXED,)),
        (
            model.actuator_biastype[motor],
            (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE),
        ),
    )
    return not all(int(found) in map(int, kinds) for found, kinds in plain)


def _on_joint(model: mujoco.MjModel, motor: int) -> bool:
    return int(model.actuator_trntype[motor]) == int(mujoco.mjtTrn.mjTRN_JOINT)


def _name(model: mujoco.MjModel, motor: int) -> str:
    return repr(model.actuator(motor).name or motor)
