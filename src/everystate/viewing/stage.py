"""The studio's 3-D scene: the body, the ghost of its goal and its plan, drawn by the browser."""

from collections.abc import Callable

import mujoco
import numpy as np
import viser
from jaxtyping import Float
from mujoco import mjtGeom

from everystate.envs.body import Body
from everystate.envs.rendering import GHOST, overview
from everystate.viewing.shapes import shell, solid

Pull = Callable[[int, Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]], None]
"""Told which of the model's bodies was dragged at, from where and to where."""

_SECTION = 1.0
"""Metres between the strong lines of the floor."""
_RED, _BLUE = (213, 94, 0), (0, 114, 178)  # plots.RED, plots.BLUE
_HIDDEN = 3  # MuJoCo's viewers do not show geoms of this group and above, nor do we


class Stage:
    """Shows states; nothing is simulated here."""

    def __init__(self, server: viser.ViserServer, body: Body, pull: Pull) -> None:
        """Puts a body and what surrounds it on the page; `pull` is told of drags at it."""
        self.body, self.model, self._server = body, body.load(), server
        self._data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self._data)
        self._bodies, self._ghosts, self._moving = {}, {}, {}
        self._goal: Float[np.ndarray, " state"] | None = None
        self._heading = 0.0
        none, width = np.zeros((0, 2, 3)), 0.015 * self.model.stat.extent
        draw = server.scene.add_line_segments
        self._trail = draw("/trail", none, _RED, thickness=width)
        self._ahead = draw("/ahead", none, _BLUE, thickness=width / 2)
        for index in range(self.model.nbody):
            if not (geoms := self._geoms(index)):
                continue
            drawn = server.scene.add_mesh_trimesh(f"/body/{index}", solid(self.model, geoms))
            self._bodies[index] = drawn
            self._place(drawn, index)
            if self.model.body_weldid[index]:  # 0: fixed to the world
                self._let_pull(drawn, index, pull)
                self._ghosts[index] = server.scene.add_mesh_simple(
                    f"/goal/{index}",
                    *shell(self.model, geoms, body.ghost_scale),
                    color=GHOST[:3],
                    opacity=0.3,
                    cast_shadow=False,
                    receive_shadow=False,
                )
        self._floors(server)
        self._look(server)

    def show(
        self,
        state: Float[np.ndarray, " state"],
        trail: Float[np.ndarray, "steps 2"] | None = None,
        ahead: Float[np.ndarray, "horizon state"] | None = None,
        heading: float = 0.0,
    ) -> None:
        """The body in a state, facing `heading` if it does not observe which way it faces.

        A body that travels without observing where it is stays in the middle, and the floor moves
        on below it: `trail` is where it has been, from the oldest place to the one where it is.
        `ahead` are the states to which it plans to go: each part of it has a line through them.
        """
        turned, self._heading = heading != self._heading, heading
        planned = self._planned(ahead)
        with self._server.atomic():  # no browser draws half of it
            if turned and self._goal is not None:
                self.show_goal(self._goal)
            self._pose(state)
            for index in self._ghosts:
                self._place(self._bodies[index], index)
            if trail is not None:
                self._travel(trail)
            if len(planned) or len(self._ahead.points):
                self._ahead.points = planned

    def _travel(self, trail: Float[np.ndarray, "steps 2"]) -> None:
        home = self.model.qpos0[self.body.unseen[0] :][:2]
        for floor, place in self._moving.values():
            floor.position = place - np.array([*np.remainder(trail[-1], _SECTION), 0.0])
        points = np.full((len(trail), 3), 0.01)
        points[:, :2] = trail - trail[-1] + home
        self._trail.points = _lines(points)

    def _planned(self, ahead: Float[np.ndarray, "horizon state"] | None) -> np.ndarray:
        """Lines [n, 2, 3] of the centres of mass of its parts."""
        if ahead is None:
            return np.zeros((0, 2, 3))
        travelled = self.body.carried(ahead, self._heading)
        centres = []
        for state, gone in zip(ahead, travelled, strict=True):
            self._pose(state, gone)
            centres.append(self._data.xipos[list(self._ghosts)])
        return np.concatenate([_lines(part) for part in np.stack(centres, axis=1)])

    def show_goal(self, goal: Float[np.ndarray, " state"]) -> None:
        """Its ghost in another."""
        self._goal = goal
        self._pose(goal)
        for index, ghost in self._ghosts.items():
            self._place(ghost, index)

    def _let_pull(self, drawn: viser.GlbHandle, index: int, pull: Pull) -> None:
        """By the mouse: an arrow from the point dragged at to where it was dragged."""

        async def dragged(event: viser.SceneNodeDragEvent) -> None:
            start, end = np.array(event.start_position), np.array(event.end_position)
            way = np.stack([start, end])[None]
            arrow = self._server.scene.add_arrows("/pull", way, _RED)
            if event.phase == "end":
                arrow.remove()
                pull(index, start, end)

        drawn.on_drag(dragged)

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

    def _pose(
        self, state: Float[np.ndarray, " state"], gone: Float[np.ndarray, " gone"] | None = None
    ) -> None:
        """Puts the model there, and on by `gone`; else where it is, facing where it does."""
        one = np.asarray(state, dtype=np.float64)[None]
        on = self.body.carried(one, self._heading) if gone is None else gone[None]
        self._data.qpos[:] = self.body.moved(self.body.place(one)[0], on)[0]
        mujoco.mj_kinematics(self.model, self._data)

    def _place(self, handle: viser.SceneNodeHandle, index: int) -> None:
        handle.position, handle.wxyz = self._data.xpos[index], self._data.xquat[index]

    def _look(self, server: viser.ViserServer) -> None:
        """From where the films look, a little farther off: beside the panel a page is narrow."""
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


def _lines(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n-1 2 3"]:
    """From each point to the next."""
    return np.stack([points[:-1], points[1:]], axis=1)
