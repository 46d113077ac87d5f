"""The studio's 3-D scene: the body and the ghost of its goal, drawn by the browser."""

import mujoco
import numpy as np
import viser
from jaxtyping import Float
from mjviser.conversions import merge_geoms
from mujoco import mjtGeom

from everystate.envs.body import Body, load_model
from everystate.envs.rendering import GHOST, overview

_SECTION = 1.0
"""Metres between the strong lines of the floor."""
_TRAIL = (213, 94, 0)
_HIDDEN = 3  # MuJoCo's viewers do not show geoms of this group and above, nor do we


class Stage:
    """Shows states; nothing is simulated here."""

    def __init__(self, server: viser.ViserServer, body: Body) -> None:
        """Puts a body and what surrounds it on the page."""
        self.body, self.model, self._server = body, load_model(body.xml), server
        self._data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self._data)
        self._bodies, self._ghosts, self._moving = {}, {}, {}
        for index in range(self.model.nbody):
            if not (geoms := self._geoms(index)):
                continue
            mesh = merge_geoms(self.model, geoms)
            self._bodies[index] = server.scene.add_mesh_trimesh(f"/body/{index}", mesh)
            self._place(self._bodies[index], index)
            if self.model.body_weldid[index]:  # 0: fixed to the world
                self._ghosts[index] = server.scene.add_mesh_simple(
                    f"/goal/{index}",
                    np.asarray(mesh.vertices) * body.ghost_scale,
                    np.asarray(mesh.faces),
                    color=GHOST[:3],
                    opacity=0.35,
                    cast_shadow=False,
                    receive_shadow=False,
                )
        self._floors(server)
        self._look(server)

    def show(
        self, state: Float[np.ndarray, " state"], trail: Float[np.ndarray, "steps 2"] | None = None
    ) -> None:
        """The body in a state.

        A body that travels without observing where it is stays in the middle, and the floor moves
        on below it: `trail` is where it has been, from the oldest place to the one where it is.
        """
        self._pose(state)
        with self._server.atomic():  # no browser draws half of it
            for index in self._ghosts:
                self._place(self._bodies[index], index)
            if trail is not None:
                self._travel(trail)

    def _travel(self, trail: Float[np.ndarray, "steps 2"]) -> None:
        home = self.model.qpos0[self.body.unseen[0] :][:2]
        for floor, place in self._moving.values():
            floor.position = place - np.array([*np.remainder(trail[-1], _SECTION), 0.0])
        points = np.full((len(trail), 3), 0.01, dtype=np.float32)
        points[:, :2] = trail - trail[-1] + home
        self._server.scene.add_point_cloud("/trail", points, _TRAIL, point_size=0.03)

    def show_goal(self, goal: Float[np.ndarray, " state"]) -> None:
        """Its ghost in another."""
        self._pose(goal)
        for index, ghost in self._ghosts.items():
            self._place(ghost, index)

    def _geoms(self, index: int) -> list[int]:
        """Those that are seen, but for floors."""
        first = self.model.body_geomadr[index]
        return [
            geom
            for geom in range(first, first + self.model.body_geomnum[index])
            if self.model.geom_group[geom] < _HIDDEN
            and self.model.geom_rgba[geom, 3] > 0
            and self.model.geom_type[geom] != mjtGeom.mjGEOM_PLANE
        ]

    def _floors(self, server: viser.ViserServer) -> None:
        for geom in range(self.model.ngeom):
            flat = self.model.geom_type[geom] == mjtGeom.mjGEOM_PLANE
            if flat and self.model.geom_group[geom] < _HIDDEN:
                width, height = (2 * x or 20.0 for x in self.model.geom_size[geom, :2])
                place = self._data.geom_xpos[geom].copy()
                grid = server.scene.add_grid(
                    f"/floor/{geom}",
                    width=width,
                    height=height,
                    cell_size=0.25,
                    section_size=_SECTION,
                    plane_color=(236, 237, 240),
                    plane_opacity=1.0,
                    position=place,
                )
                self._moving[geom] = grid, place

    def _pose(self, state: Float[np.ndarray, " state"]) -> None:
        self._data.qpos[:] = self.body.place(np.asarray(state, dtype=np.float64)[None])[0][0]
        mujoco.mj_kinematics(self.model, self._data)

    def _place(self, handle: viser.SceneNodeHandle, index: int) -> None:
        handle.position, handle.wxyz = self._data.xpos[index], self._data.xquat[index]

    def _look(self, server: viser.ViserServer) -> None:
        """From where the films look, a little farther off, as a panel covers a part of the page."""
        camera = server.initial_camera
        if self.body.camera != -1:
            named = self._data.camera(self.body.camera)
            forth = -named.xmat.reshape(3, 3)[:, 2]
            distance = float(np.linalg.norm(named.xpos - self.model.stat.center))
            look_at = named.xpos + distance * forth
            camera.fov = float(np.radians(self.model.camera(self.body.camera).fovy[0]))
        else:
            free = overview(self.model)
            turn, tilt = np.radians([free.azimuth, free.elevation])
            forth = np.array(
                [np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)]
            )
            distance, look_at = free.distance, free.lookat.copy()
            camera.fov = float(np.radians(self.model.vis.global_.fovy))
        camera.position, camera.look_at = look_at - 1.25 * distance * forth, look_at
