"""MuJoCo bodies, stepped together.

`mujoco.batch.Batch` steps them on a thread pool, bit for bit as `mj_step` does one by one and so
independently of the number of threads.
"""

import os
from collections.abc import Sequence

import mujoco
import mujoco.batch
import numpy as np
from jaxtyping import Bool, Float, Shaped, UInt8

from everystate.envs.body import Body
from everystate.envs.checks import require_finite
from everystate.envs.disturbance import Disturbance
from everystate.envs.model_copy import model_hash
from everystate.envs.rendering import Along, render_states
from everystate.envs.vector import BodyVectorEnv, Physics
from everystate.errors import EverystateError

# mjSTATE_INTEGRATION by name: all that decides the future of a simulation.
_PHYSICS = (
    *("time", "qpos", "qvel", "act", "history", "qacc_warmstart"),
    *("ctrl", "qfrc_applied", "xfrc_applied", "eq_active"),
    *("mocap_pos", "mocap_quat", "userdata", "plugin_state"),
)


class MujocoVectorEnv(BodyVectorEnv):
    """A vector environment without reward, termination, truncation or autoreset."""

    def __init__(
        self,
        body: Body,
        num_envs: int,
        seed: int | None = None,
        *,
        num_threads: int | None = None,
        render_mode: str | None = None,
        disturbance: Disturbance | None = None,
    ) -> None:
        """No seed: a different run each time, as Gymnasium has it.

        `num_threads` changes speed only; by default one for every 16 bodies, up to the cores.
        """
        if num_threads is None:
            num_threads = max(1, min(os.cpu_count() or 1, num_envs // 16))
        if num_threads < 1:
            raise EverystateError(f"num_threads is {num_threads}: at least one is needed")
        disturbance = disturbance or Disturbance()
        self.body = body
        self.name, self.source = body.name, body.source
        self.state_names, self.state_units = body.state_names, body.state_units
        self.nominal, self.horizontal = (body.centre, body.spread), body.horizontal
        self.model = body.load()
        self.model_hash = model_hash(self.model)
        disturbance.perturb(self.model)
        self.control_step = self.model.opt.timestep * body.frame_skip * disturbance.action_repeat
        super().__init__(
            num_envs, seed, body.low, body.high, self.model.nu, disturbance, render_mode
        )
        self._batch = mujoco.batch.Batch(self.model, num_envs, nthread=num_threads)
        self._physics = {name: self._batch.bind(name) for name in _PHYSICS}
        low, high = _motor_bounds(self.model)
        self.action_names, self.action_bounds = _motor_names(self.model), (low, high)
        even = (low == -1).all() and (high == 1).all()
        self._ctrl_range = None if even else ((low + high) / 2, (high - low) / 2)
        self._drives = type(body).drive is not Body.drive
        self.reset()

    def set_observations(self, observations: Float[np.ndarray, "envs state"]) -> None:
        """Puts the bodies into the given states, as if they had just been built there."""
        observations = np.asarray(observations, dtype=np.float64)
        if observations.shape != self.observation_space.shape:
            raise EverystateError(
                f"observations have shape {observations.shape}: expected"
                f" {self.observation_space.shape}"
            )
        require_finite(observations, self.state_names)
        self._put(*self.body.place(observations))

    def _put(
        self,
        qpos: Float[np.ndarray, "n nq"],
        qvel: Float[np.ndarray, "n nv"],
        which: Bool[np.ndarray, " envs"] | None = None,
    ) -> None:
        """As if just built there: no warm start, no activation of motors."""
        ids = np.arange(self.num_envs) if which is None else np.flatnonzero(which)
        self._batch.reset(ids=ids, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._physics["qpos"][ids], self._physics["qvel"][ids] = qpos, qvel

    def get_physics(self) -> list[Physics]:
        """qpos and qvel of each body, unrounded."""
        columns = (self._physics[name].tolist() for name in ("qpos", "qvel"))
        return [{"qpos": q, "qvel": v} for q, v in zip(*columns, strict=True)]

    def set_physics(
        self, states: Sequence[Physics], which: Bool[np.ndarray, " envs"] | None = None
    ) -> None:
        """Puts bodies to such a qpos and qvel, as if they had just been built there."""
        count = self.num_envs if which is None else int(which.sum())
        shapes = {name: (count, *self._physics[name].shape[1:]) for name in ("qpos", "qvel")}
        try:
            given = {n: np.array([s[n] for s in states], dtype=np.float64) for n in shapes}
        except (KeyError, TypeError, ValueError) as error:
            raise EverystateError(
                f"a physics state of {self.name} needs numbers for qpos and qvel: {error}"
            ) from error
        for name, shape in shapes.items():
            if given[name].shape != shape or not np.isfinite(given[name]).all():
                raise EverystateError(
                    f"{name} of the physics states has shape {given[name].shape}: expected finite"
                    f" numbers in the shape {shape} for {count} x {self.name}"
                )
        self._put(given["qpos"], given["qvel"], which)

    def get_state(self) -> dict[str, np.ndarray]:
        """All that decides the future: the physics, and where the random numbers stand."""
        state = {name: field.copy() for name, field in self._physics.items() if field.size}
        return state | {"random": np.array([self._seed, self._draws], dtype=np.uint64)}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Continues bit for bit from what `get_state` returned."""
        expected = {name: field.shape for name, field in self._physics.items() if field.size}
        expected["random"] = (2,)
        found = {name: np.shape(array) for name, array in state.items()}
        if found != expected:
            wrong = sorted(n for n in expected | found if expected.get(n) != found.get(n))
            raise EverystateError(
                f"the state does not belong to {self.num_envs} x {self.name}: {wrong[0]!r} has"
                f" shape {found.get(wrong[0])}, expected {expected.get(wrong[0])}"
            )
        for name in expected.keys() - {"random"}:
            self._physics[name][:] = state[name]
        self._seed, self._draws = (int(n) for n in state["random"])

    def regions(self, observations: Float[np.ndarray, "*n state"]) -> Shaped[np.ndarray, "*n"]:
        """The name of the part of the world each state lies in."""
        return self.body.regions(np.asarray(observations))

    def scored(self, observations: Float[np.ndarray, "*n state"]) -> Float[np.ndarray, "*n scored"]:
        """What a success metric compares; a new array."""
        return np.array(self.body.scored(np.asarray(observations)))

    def falls(
        self, before: Float[np.ndarray, "*n state"], after: Float[np.ndarray, "*n state"]
    ) -> Bool[np.ndarray, "*n"]:
        """Which control steps from `before` to `after` were falls."""
        return self.body.falls(np.asarray(before), np.asarray(after))

    def render_states(
        self,
        observations: Float[np.ndarray, "steps state"],
        goal: Float[np.ndarray, "*steps state"] | None = None,
        width: int = 320,
        height: int = 240,
        along: Along | None = None,
    ) -> UInt8[np.ndarray, "steps height width 3"]:
        """Pictures of stored states; goals, one or one each, appear as translucent ghosts."""
        return render_states(self.model, self.body, observations, goal, width, height, along)

    def render(self) -> tuple[UInt8[np.ndarray, "height width 3"], ...] | None:
        """One picture of each body as it stands now."""
        return tuple(self.render_states(self._observe())) if self.render_mode else None

    def _start(self, which: Bool[np.ndarray, " envs"]) -> None:
        self.set_observations(self.body.initial(self.num_envs, self._rng()))

    def _advance(self, actions: Float[np.ndarray, "envs action"]) -> Bool[np.ndarray, " envs"]:
        # Making a generator takes as long as a physics step of a small body.
        signals = self.body.drive(actions, self._rng()) if self._drives else actions
        if self._ctrl_range is not None:
            middle, half = self._ctrl_range
            signals = middle + half * signals
        self._physics["ctrl"][:] = signals
        if self.disturbance.push:
            seconds = self.model.opt.timestep * self.body.frame_skip
            forces = self.disturbance.pushes(self.model, self.num_envs, seconds, self._rng())
            self._physics["xfrc_applied"][:] = forces.reshape(self._physics["xfrc_applied"].shape)
        self._batch.step(nstep=self.body.frame_skip)
        self.body.finish(self._batch)
        return self._never

    def _observe(self) -> Float[np.ndarray, "envs state"]:
        return self.body.observe(self._physics["qpos"], self._physics["qvel"])

    def _measurable(self) -> BodyVectorEnv:
        return MujocoVectorEnv(self.body, 20, 0)


def _motor_bounds(
    model: mujoco.MjModel,
) -> tuple[Float[np.ndarray, " nu"], Float[np.ndarray, " nu"]]:
    """Least and most of what the motors take: -1 and 1 where they have no bounds."""
    low, high = np.where(model.actuator_ctrllimited[:, None], model.actuator_ctrlrange, [-1, 1]).T
    return low, high


def _motor_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """As in the file, or else those of their joints, or else by their number."""
    on_joint = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    names = []
    for i in range(model.nu):
        name = model.actuator(i).name
        if not name and int(model.actuator_trntype[i]) in on_joint:
            name = model.joint(model.actuator_trnid[i, 0]).name
        names.append(name or f"motor{i}")
    return tuple(names)
