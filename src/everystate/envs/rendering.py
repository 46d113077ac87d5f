"""Pictures of states, without simulating them again."""

import ctypes.util
import functools
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float, Int, UInt8
from mujoco.rendering.classic import gl_context

from everystate.envs.body import FLOOR, Body
from everystate.errors import EverystateError

GHOST = (0.0, 0.9, 0.2, 0.26)
_TRAIL = (0.83, 0.37, 0.0, 1.0)
_DOTS, _MOST_DOTS = 5, 200
"""A dot of the trail for so many steps; and how many there are at most."""
_POSES = 100
"""Random ones, of which a view of the whole is made."""


def render_states(
    model: mujoco.MjModel,
    body: Body,
    observations: Float[np.ndarray, "steps state"],
    goal: Float[np.ndarray, "*steps state"] | None,
    width: int,
    height: int,
    along: "Along | None" = None,
) -> UInt8[np.ndarray, "steps height width 3"]:
    """One picture per state from the body's camera; goals, one or one each, as green ghosts.

    What travels without observing where it is begins where it was drawn; `along` a path it is where
    it has got to, its goal too, and a trail shows how.
    """
    poses, _ = body.place(np.asarray(observations, dtype=np.float64))
    path = np.zeros((1, 3 * len(body.unseen))) if along is None else body.carried(along.states)
    carried = path[np.zeros(len(poses), dtype=int) if along is None else along.at]
    poses = body.moved(poses, carried)
    data, ghost = mujoco.MjData(model), mujoco.MjData(model)
    ghosts = [None] * len(poses)
    if goal is not None:
        goals = np.broadcast_to(np.asarray(goal, dtype=np.float64), np.shape(observations))
        ghosts = list(body.moved(body.place(goals)[0], carried))
    frames = np.empty((len(poses), height, width, 3), dtype=np.uint8)
    own, ground = overview(model) if body.camera == -1 else None, _ground(model)
    free = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    with _renderer(model, width, height) as renderer:
        for number, (frame, pose, ghost_pose) in enumerate(zip(frames, poses, ghosts, strict=True)):
            data.qpos[:] = pose
            mujoco.mj_fwdPosition(model, data)
            if own is not None and len(free):
                own.lookat[:] = data.xpos[free[0]]
            renderer.update_scene(data, camera=body.camera if own is None else own)
            if ground is not None:
                _add_ground(ground, renderer.scene)
            if ghost_pose is not None:
                ghost.qpos[:] = ghost_pose
                mujoco.mj_kinematics(model, ghost)
                _add_ghost(model, ghost, renderer.scene, body.ghost_scale)
            if along is not None:
                _add_trail(model, body, path[: along.at[number] + 1], renderer.scene)
            frame[:] = renderer.render()
    return frames


def overview(model: mujoco.MjModel) -> mujoco.MjvCamera:
    """A view of all places to which the joints can bring the body from where it was drawn."""
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    if (ends := _reach(model)) is None:
        return camera
    low, high = ends
    camera.lookat[:] = (low + high) / 2
    fovy = np.radians(model.vis.global_.fovy)
    free = model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
    share = 0.34 if free.any() else 0.48  # nearer to what the camera goes along with
    camera.distance = share * float(np.linalg.norm(high - low)) / np.tan(fovy / 2)
    camera.azimuth, camera.elevation = 90, -20 if free.any() else -10
    return camera


def _reach(
    model: mujoco.MjModel,
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]] | None:
    """Corners of a box with all places to which the joints can bring what is seen of the body."""
    moving = (model.body_weldid[model.geom_bodyid] > 0) & (model.geom_rbound > 0)
    if not moving.any():
        return None
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    hinge, slide = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    ends = []
    for _ in range(_POSES):
        data.qpos[:] = model.qpos0
        for joint in range(model.njnt):
            kind, at = model.jnt_type[joint], model.jnt_qposadr[joint]
            if model.jnt_limited[joint] and kind in (hinge, slide):
                data.qpos[at] = rng.uniform(*model.jnt_range[joint])
            elif kind == hinge:
                data.qpos[at] = rng.uniform(-np.pi, np.pi)
        mujoco.mj_kinematics(model, data)
        around = model.geom_rbound[moving, None]
        ends += [data.geom_xpos[moving] - around, data.geom_xpos[moving] + around]
    return np.concatenate(ends).min(axis=0), np.concatenate(ends).max(axis=0)


class Along(NamedTuple):
    """Which steps of a path are drawn."""

    states: Float[np.ndarray, "path state"]
    at: Int[np.ndarray, " steps"]


@contextmanager
def headless() -> Iterator[None]:
    """Lets libraries that ask MUJOCO_GL draw by EGL where there is no screen, as we do."""
    no_screen = sys.platform == "linux" and not os.environ.get("DISPLAY")
    if not no_screen or "MUJOCO_GL" in os.environ or not _has_egl():
        yield
        return
    os.environ["MUJOCO_GL"] = "egl"
    try:
        yield
    finally:
        del os.environ["MUJOCO_GL"]  # without EGL's libraries it would break `import mujoco`


@functools.cache
def _has_egl() -> bool:
    return ctypes.util.find_library("EGL") is not None


def _add_ghost(
    model: mujoco.MjModel, ghost: mujoco.MjData, scene: mujoco.MjvScene, scale: float
) -> None:
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
        geom.transparent = 1  # or it hides the body that has reached it
        geom.rgba[:] = GHOST
        geom.emission = 0.3
        geom.size[:] *= scale


def _ground(model: mujoco.MjModel) -> float | None:
    """How high the floor lies that is drawn below a body held in the air; None where there is one.

    Nor has a body that could fall on it a floor that is not there.
    """
    fixed = model.body_weldid[model.geom_bodyid] == 0
    falls = model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
    ends = None if fixed.any() or falls.any() else _reach(model)
    return None if ends is None else float(ends[0][2])


def _add_ground(height: float, scene: mujoco.MjvScene) -> None:
    geom, flat = scene.geoms[scene.ngeom], np.eye(3).ravel()
    plane, color = mujoco.mjtGeom.mjGEOM_PLANE, np.array(FLOOR, dtype=np.float32)
    size, where = np.array([100.0, 100.0, 1.0]), np.array([0.0, 0.0, height])
    mujoco.mjv_initGeom(geom, plane, size, where, flat, color)
    scene.ngeom += 1


def _add_trail(
    model: mujoco.MjModel,
    body: Body,
    carried: Float[np.ndarray, "path gone"],
    scene: mujoco.MjvScene,
) -> None:
    """Dots on the floor, where each of what travels unseen has been."""
    size, flat = np.array([0.05, 0.002, 0.0]), np.eye(3).ravel()  # radius, half the height
    color = np.array(_TRAIL, dtype=np.float32)
    for x, at in zip(body.unseen, range(0, carried.shape[1], 3), strict=True):
        for place in (model.qpos0[x : x + 2] + carried[:, at : at + 2])[::_DOTS][-_MOST_DOTS:]:
            geom = scene.geoms[scene.ngeom]
            cylinder, where = mujoco.mjtGeom.mjGEOM_CYLINDER, np.array([*place, 0.002])
            mujoco.mjv_initGeom(geom, cylinder, size, where, flat, color)
            scene.ngeom += 1


def _renderer(model: mujoco.MjModel, width: int, height: int) -> mujoco.Renderer:
    """A renderer that also works where there is no screen."""
    vis = model.vis.global_
    if not (0 < width <= vis.offwidth and 0 < height <= vis.offheight):
        raise EverystateError(
            f"picture size {width} x {height}: choose at most {vis.offwidth} x {vis.offheight}"
        )
    chosen = os.environ.get("MUJOCO_GL") or os.environ.get("DISPLAY")
    try:
        if sys.platform == "linux" and not chosen:
            # MuJoCo reads MUJOCO_GL when it is imported, which has long happened: hand it EGL here.
            from mujoco import egl

            gl_context.GLContext = egl.GLContext
        return mujoco.Renderer(model, height=height, width=width)
    except Exception as error:  # what is raised depends on which of the libraries is missing
        raise EverystateError(
            "cannot draw without a screen: install EGL with"
            f" `apt-get install libegl1 libgl1-mesa-dri` ({type(error).__name__}: {error})"
        ) from error
