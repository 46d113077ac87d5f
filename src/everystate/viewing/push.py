"""A hand on the body: how its state changes when a point of it is pulled at."""

import mujoco
import numpy as np
from jaxtyping import Float

from everystate.envs.body import Body
from everystate.errors import EverystateError

_GAIN = 4.0
"""A point pulled a metre aside moves at so many m/s after it."""
_SHIFT = 0.25
"""Seconds of that motion, by which a body that has no velocities is moved."""
_DAMPING = 0.05
"""What it can hardly do moves it little: else a pole pulled along itself would whirl."""


def pulled(
    model: mujoco.MjModel,
    body: Body,
    state: Float[np.ndarray, " state"],
    part: int,
    start: Float[np.ndarray, " 3"],
    end: Float[np.ndarray, " 3"],
    heading: float = 0.0,
) -> Float[np.ndarray, " state"]:
    """The state after an impulse at a point of the body, towards another.

    Args:
        model: of the body, with its masses.
        body: how states are placed and observed.
        state: before.
        part: which of the model's bodies is pulled at.
        start: the point of it, in the world's frame, in metres.
        end: where to; a way longer than the model counts as one that long.
        heading: of a body that does not observe its own, in radians.

    Raises:
        EverystateError: a point that is not finite.
    """
    start, way = np.asarray(start, dtype=np.float64), np.asarray(end) - np.asarray(start)
    if not np.isfinite([start, way]).all():
        raise EverystateError(f"pull from {start} to {end}: both must be finite")
    if heading:  # `place` has it face 0
        home = np.append(model.qpos0[body.unseen[0] :][:2], 0.0)
        back = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        start = start - home
        start[:2], way[:2] = back @ start[:2], back @ way[:2]
        start = start + home
    way = way * min(1.0, float(model.stat.extent / max(np.linalg.norm(way), 1e-9)))
    qpos, qvel = body.place(np.asarray(state, dtype=np.float64)[None])
    data = mujoco.MjData(model)
    data.qpos[:] = qpos[0]
    mujoco.mj_forward(model, data)
    inertia, jacobian = np.zeros((model.nv, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    mujoco.mj_jac(model, data, jacobian, None, start, part)
    follows = np.linalg.solve(inertia, jacobian.T)
    yields = jacobian @ follows
    damped = yields + _DAMPING * np.trace(yields) * np.eye(3)
    change = follows @ np.linalg.solve(damped, _GAIN * way)
    if any(unit.endswith("/s") for unit in body.state_units):
        qvel = qvel + change
    else:
        mujoco.mj_integratePos(model, qpos[0], change, _SHIFT)
    return body.observe(qpos, qvel)[0]
