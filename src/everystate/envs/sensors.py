"""Sensors of a model as further components of a state."""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float
from mujoco import mjtSensor

# Only what follows from positions and velocities: forces and accelerations depend on the action,
# and what a joint's sensor says is in the state already.
_UNITS = {
    mjtSensor.mjSENS_FRAMEPOS: "m",
    mjtSensor.mjSENS_FRAMEXAXIS: "1",
    mjtSensor.mjSENS_FRAMEYAXIS: "1",
    mjtSensor.mjSENS_FRAMEZAXIS: "1",
    mjtSensor.mjSENS_FRAMELINVEL: "m/s",
    mjtSensor.mjSENS_FRAMEANGVEL: "rad/s",
    mjtSensor.mjSENS_VELOCIMETER: "m/s",
    mjtSensor.mjSENS_GYRO: "rad/s",
    mjtSensor.mjSENS_SUBTREECOM: "m",
    mjtSensor.mjSENS_SUBTREELINVEL: "m/s",
    mjtSensor.mjSENS_RANGEFINDER: "m",
}
KINDS = tuple(kind.name.removeprefix("mjSENS_").lower() for kind in _UNITS)
"""Those that can be observed, by their names in MJCF."""


class Reading(NamedTuple):
    """One number of a sensor."""

    name: str
    unit: str
    at: int
    """Where it lies in `sensordata`."""


def readings(model: mujoco.MjModel) -> Iterator[Reading]:
    """What of a model's sensors can be observed, named after them."""
    for i in range(model.nsensor):
        unit = _UNITS.get(mjtSensor(model.sensor_type[i]))
        if unit is None:
            continue
        name, size = model.sensor(i).name or f"sensor{i}", int(model.sensor_dim[i])
        for part in range(size):
            suffix = "" if size == 1 else f"_{'xyz'[part]}" if size == 3 else f"_{part}"
            yield Reading(name + suffix, unit, int(model.sensor_adr[i]) + part)


def sensed(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    qpos: Float[np.ndarray, "envs nq"],
    qvel: Float[np.ndarray, "envs nv"],
) -> Float[np.ndarray, "envs sensordata"]:
    """What all sensors of positions and velocities say of each physics state."""
    found = np.empty((len(qpos), model.nsensordata))
    for row, data.qpos[:], data.qvel[:] in zip(found, qpos, qvel, strict=True):
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_sensorPos(model, data)
        mujoco.mj_sensorVel(model, data)
        row[:] = data.sensordata
    return found
