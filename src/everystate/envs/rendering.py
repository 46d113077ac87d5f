"""Pictures of states, without simulating them again."""

import os
import sys

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from everystate.envs.body import Body
from everystate.errors import EverystateError

GHOST = (0.05, 0.65, 0.25, 0.55)


def render_states(
    model: mujoco.MjModel,
    body: Body,
    observations: Float[np.ndarray, "steps state"],
    goal: Float[np.ndarray, " state"] | None,
    width: int,
    height: int,
) -> UInt8[np.ndarray, "steps height width 3"]:
    """One picture per state from the body's camera; the goal as a translucent green ghost."""
    poses, _ = body.place(np.asarray(observations, dtype=np.float64))
    data, ghost = mujoco.MjData(model), mujoco.MjData(model)
    if goal is not None:
        ghost.qpos[:] = body.place(np.asarray(goal, dtype=np.float64)[None])[0][0]
        mujoco.mj_forward(model, ghost)
    frames = np.empty((len(poses), height, width, 3), dtype=np.uint8)
    with _renderer(model, width, height) as renderer:
        for frame, pose in zip(frames, poses, strict=True):
            data.qpos[:] = pose
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera=body.camera)
            if goal is not None:
                _add_ghost(model, ghost, renderer.scene)
            frame[:] = renderer.render()
    return frames


def _add_ghost(model: mujoco.MjModel, ghost: mujoco.MjData, scene: mujoco.MjvScene) -> None:
    first = scene.ngeom
    mujoco.mjv_addGeoms(
        model,
        ghost,
        mujoco.MjvOption(),
        mujoco.MjvPerturb(),
        mujoco.mjtCatBit.mjCAT_DYNAMIC.value,
        scene,
    )
    for geom in scene.geoms[first : scene.ngeom]:
        geom.matid = -1
        geom.rgba[:] = GHOST


def _renderer(model: mujoco.MjModel, width: int, height: int) -> mujoco.Renderer:
    """A renderer that also works where there is no screen."""
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")
    return mujoco.Renderer(model, height=height, width=width)
