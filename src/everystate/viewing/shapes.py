"""What the browser draws of a model: smooth solids of its geoms, and shells around them."""

from collections.abc import Sequence

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float, Int
from mjviser.conversions import merge_geoms
from mujoco import mjtGeom
from trimesh.visual import ColorVisuals

_ROUND = 4  # subdivisions of a ball, which make 5120 faces
_SHARP = np.radians(30)
"""Faces that meet at a larger angle have an edge between them."""
_MARGIN = 0.06
_THINNER = 0.02
"""Both of half a body's thickness."""


def solid(model: mujoco.MjModel, geoms: Sequence[int]) -> trimesh.Trimesh:
    """Geoms of one body in its frame, coloured, with the normals that smooth shading needs.

    Every other body of a chain is a little thinner: two that share the ball of a joint would both
    be seen in it, in specks.
    """
    mesh = trimesh.util.concatenate([_smooth(model, geom) for geom in geoms])
    assert isinstance(mesh, trimesh.Trimesh)
    normals = np.array(mesh.vertex_normals)
    if _depth(model, int(model.geom_bodyid[geoms[0]])) % 2:
        mesh.vertices -= _THINNER * float(mesh.extents.min()) / 2 * normals
    mesh.vertex_normals = normals  # an export has those that are set
    return mesh


def shell(
    model: mujoco.MjModel, geoms: Sequence[int], scale: float
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"]]:
    """Geoms of one body, a little larger, so that no face of theirs lies in a face of `solid`."""
    mesh = merge_geoms(model, list(geoms))
    margin = _MARGIN * float(mesh.extents.min()) / 2
    vertices = np.asarray(mesh.vertices) * scale + np.asarray(mesh.vertex_normals) * margin
    return vertices, np.asarray(mesh.faces)


def _depth(model: mujoco.MjModel, index: int) -> int:
    return 0 if index == 0 else 1 + _depth(model, int(model.body_parentid[index]))


def _smooth(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh:
    mesh = merge_geoms(model, [geom])
    if not isinstance(mesh.visual, ColorVisuals):
        return mesh  # its texture has a place for each vertex
    kind, size = mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    if kind not in (mjtGeom.mjGEOM_SPHERE, mjtGeom.mjGEOM_ELLIPSOID):
        return trimesh.graph.smooth_shade(mesh, angle=_SHARP)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    ball = trimesh.creation.icosphere(subdivisions=_ROUND)
    ball.apply_scale(size if kind == mjtGeom.mjGEOM_ELLIPSOID else size[0])
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = turn.reshape(3, 3), model.geom_pos[geom]
    ball.apply_transform(placed)
    color = np.asarray(mesh.visual.vertex_colors)[0]
    ball.visual = ColorVisuals(ball, vertex_colors=np.tile(color, (len(ball.vertices), 1)))
    return ball
