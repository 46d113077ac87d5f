"""Many copies of one MuJoCo body, stepped together and never reset unless asked.

`mujoco.batch.Batch` steps them on a thread pool, bit for bit as `mj_step` does one by one and so
independently of the number of threads.
"""

import os
import secrets
from typing import Any, ClassVar

import gymnasium
import mujoco
import mujoco.batch
import numpy as np
from gymnasium.vector import AutoresetMode
from jaxtyping import Bool, Float, Float32, Shaped, UInt8

from everystate.envs.body import Body
from everystate.envs.rendering import render_states
from everystate.errors import EverystateError

# mjSTATE_INTEGRATION by name: all that decides the future of a simulation.
_PHYSICS = (
    *("time", "qpos", "qvel", "act", "history", "qacc_warmstart"),
    *("ctrl", "qfrc_applied", "xfrc_applied", "eq_active"),
    *("mocap_pos", "mocap_quat", "userdata", "plugin_state"),
)


class MujocoVectorEnv(gymnasium.vector.VectorEnv):
    """A Gymnasium vector environment without reward, termination, truncation or autoreset.

    Observations are float32 `[num_envs, state]` in the units of `state_units`; actions lie in
    [-1, 1] and are clipped to it. Arrays returned are the caller's own.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "autoreset_mode": AutoresetMode.DISABLED,
        "render_modes": ["rgb_array"],
    }

    def __init__(
        self,
        body: Body,
        num_envs: int,
        seed: int | None = None,
        *,
        num_threads: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        """No seed: a different run each time, as Gymnasium has it.

        `num_threads` changes speed only; by default one for every 16 bodies, up to the cores.
        """
        if num_envs < 1:
            raise EverystateError(f"num_envs is {num_envs}: at least one body is needed")
        if num_threads is None:
            num_threads = max(1, min(os.cpu_count() or 1, num_envs // 16))
        if num_threads < 1:
            raise EverystateError(f"num_threads is {num_threads}: at least one is needed")
        if render_mode not in (None, "rgb_array"):
            raise EverystateError(f"render_mode is {render_mode!r}: choose 'rgb_array' or None")
        self.body = body
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.state_names, self.state_units = body.state_names, body.state_units
        self.centre: Float32[np.ndarray, " state"] = np.array(body.centre, dtype=np.float32)
        self.spread: Float32[np.ndarray, " state"] = np.array(body.spread, dtype=np.float32)
        self.model = mujoco.MjModel.from_xml_path(str(body.xml))
        # A body that blows up must be seen, not silently put back where it was built.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.control_step = self.model.opt.timestep * body.frame_skip  # seconds
        self._batch = mujoco.batch.Batch(self.model, num_envs, nthread=num_threads)
        self._physics = {name: self._batch.bind(name) for name in _PHYSICS}
        self.single_observation_space = gymnasium.spaces.Box(
            np.array(body.low, dtype=np.float32), np.array(body.high, dtype=np.float32)
        )
        self.single_action_space = gymnasium.spaces.Box(
            -1.0, 1.0, shape=(self.model.nu,), dtype=np.float32
        )
        batch_space = gymnasium.vector.utils.batch_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.reset(seed=secrets.randbits(64) if seed is None else seed)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32[np.ndarray, "envs state"], dict[str, Any]]:
        """New initial states for all bodies; a seed restarts the random numbers too."""
        if seed is not None:
            if not 0 <= seed < 2**64:
                raise EverystateError(f"seed is {seed}: choose a whole number from 0 to 2^64 - 1")
            self._seed, self._draws = seed, 0
        self.set_observations(self.body.initial(self.num_envs, self._rng()))
        return self._observe(), {}

    def step(
        self, actions: Float[np.ndarray, "envs action"]
    ) -> tuple[
        Float32[np.ndarray, "envs state"],
        Float[np.ndarray, " envs"],
        Bool[np.ndarray, " envs"],
        Bool[np.ndarray, " envs"],
        dict[str, Any],
    ]:
        """One control step of every body."""
        actions = np.asarray(actions, dtype=np.float64)
        expected = (self.num_envs, self.model.nu)
        if actions.shape != expected:
            raise EverystateError(f"actions have shape {actions.shape}: expected {expected}")
        _require_finite(actions, "action", [f"component {i}" for i in range(self.model.nu)])
        self._physics["ctrl"][:] = self.body.drive(np.clip(actions, -1.0, 1.0), self._rng())
        self._batch.step(nstep=self.body.frame_skip)
        self.body.finish(self._batch)
        never = np.zeros(self.num_envs, dtype=bool)
        return self._observe(), np.zeros(self.num_envs), never, never.copy(), {}

    def set_observations(self, observations: Float[np.ndarray, "envs state"]) -> None:
        """Puts the bodies into the given states, as if they had just been built there."""
        observations = np.asarray(observations, dtype=np.float64)
        expected = (self.num_envs, len(self.state_names))
        if observations.shape != expected:
            raise EverystateError(
                f"observations have shape {observations.shape}: expected {expected}"
            )
        _require_finite(observations, "observation", self.state_names)
        self._batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._physics["qpos"][:], self._physics["qvel"][:] = self.body.place(observations)

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
                f"the state does not belong to {self.num_envs} x {self.body.name}: {wrong[0]!r} has"
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
        goal: Float[np.ndarray, " state"] | None = None,
        width: int = 320,
        height: int = 240,
    ) -> UInt8[np.ndarray, "steps height width 3"]:
        """Pictures of stored states; a goal appears as a translucent ghost."""
        return render_states(self.model, self.body, observations, goal, width, height)

    def render(self) -> tuple[UInt8[np.ndarray, "height width 3"], ...] | None:
        """One picture of each body as it stands now."""
        return tuple(self.render_states(self._observe())) if self.render_mode else None

    def _rng(self) -> np.random.Generator:
        """A fresh generator for each draw: two integers say where the random numbers stand."""
        self._draws += 1
        philox = np.random.Philox(key=[self._seed, 0], counter=[0, 0, self._draws, 0])
        return np.random.Generator(philox)

    def _observe(self) -> Float32[np.ndarray, "envs state"]:
        observations = self.body.observe(self._physics["qpos"], self._physics["qvel"])
        _require_finite(observations, "observation", self.state_names)
        return np.array(observations, dtype=np.float32)


def _require_finite(values: np.ndarray, what: str, components: Any) -> None:
    if not np.isfinite(values).all():
        env, component = np.argwhere(~np.isfinite(values))[0]
        raise EverystateError(
            f"{what} of environment {env} is {values[env, component]} in {components[component]}:"
            f" it must be finite"
        )
