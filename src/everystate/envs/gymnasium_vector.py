"""Bodies that come as Gymnasium environments, one Python object each."""

import functools
import json
from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import mujoco
import numpy as np
from gymnasium.vector import AutoresetMode
from jaxtyping import Bool, Float, UInt8

from everystate.envs import snapshot
from everystate.envs.adapt import EXTRA, ActionScaling, Flattening, make_single
from everystate.envs.disturbance import Disturbance
from everystate.envs.rendering import Along, headless
from everystate.envs.vector import BodyVectorEnv, Physics
from everystate.errors import EverystateError

_TRIED = 10  # steps on which an angle must be what is observed


class GymnasiumVectorEnv(BodyVectorEnv):
    """Any Gymnasium id with Box observations and actions, stepped one after the other.

    Time limits are taken off and rewards forgotten. Where the environment says that an episode is
    over, a MuJoCo body simply goes on; any other is put back to a start, and nothing is learned
    across that (`ends="ignore"` or `"restart"` says otherwise).
    """

    metadata: ClassVar[dict[str, Any]] = {
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "render_modes": ["rgb_array"],
    }
    placeable = False

    def __init__(
        self,
        body: str,
        num_envs: int,
        seed: int | None = None,
        *,
        render_mode: str | None = None,
        disturbance: Disturbance | None = None,
        ends: str = "auto",
        **kwargs: Any,
    ) -> None:
        """`kwargs` are those of the environment itself; `ends` is auto, ignore or restart."""
        if ends not in ("auto", "ignore", "restart"):
            raise EverystateError(f"ends is {ends!r}: choose auto, ignore or restart")
        disturbance = disturbance or Disturbance()
        if disturbance.push:
            raise EverystateError(f"{body} cannot be pushed: only bodies of our own kinds can")
        first = make_single(body, render_mode, **kwargs)
        self._flatten = Flattening(first.observation_space, body)
        self._scale = ActionScaling(first.action_space, body)
        found = snapshot.physics(first)
        if found is not None:
            self._flatten.unwind(self._winds(first, *found))
        self._kwargs = kwargs
        self.name, self.source = body, "Gymnasium"
        self.state_names, self.state_units = self._flatten.names, ("1",) * self._flatten.size
        low, high = self._flatten.low, self._flatten.high
        bounded = np.isfinite(low) & np.isfinite(high) & (low < high)
        middle, half = np.full((2, low.size), np.nan)
        middle[bounded] = (low[bounded] + high[bounded]) / 2
        half[bounded] = (high[bounded] - low[bounded]) / 2 / np.sqrt(3)  # as if uniform
        self.nominal = (middle, half)
        step = getattr(first.unwrapped, "dt", None)
        self.control_step = step * disturbance.action_repeat if isinstance(step, float) else None
        self._goes_on = ends == "ignore" or (ends == "auto" and found is not None)
        super().__init__(num_envs, seed, low, high, self._scale.size, disturbance, render_mode)
        self.action_bounds = self._scale.low, self._scale.high
        rest = [make_single(body, render_mode, **kwargs) for _ in range(num_envs - 1)]
        self.envs: list[gymnasium.Env] = [first, *rest]
        if disturbance.changes_model and found is None:
            raise EverystateError(
                f"{body} is no MuJoCo model: its mass, friction and force stay as they are"
            )
        for model, _ in filter(None, map(snapshot.physics, self.envs)):
            disturbance.perturb(model)
            # A body that blows up must be seen, not silently put back to its start.
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self._current = np.zeros((num_envs, self._flatten.size))
        self.reset()

    @functools.cached_property
    def exact_restore(self) -> bool:
        """Whether a copy that is given another one's state goes on as that does: tried out."""
        one, other = (make_single(self.name, **self._kwargs) for _ in range(2))
        actions = np.random.default_rng(0).uniform(-1, 1, (20, self._scale.size))

        def play(env: gymnasium.Env, actions: np.ndarray) -> list[np.ndarray]:
            return [self._flatten(env.step(self._scale(action))[0]) for action in actions]

        one.reset(seed=0)
        play(one, actions[:5])
        saved = json.loads(json.dumps(snapshot.take(one)))
        other.reset(seed=1)
        snapshot.put(other, saved)
        return bool(np.array_equal(play(one, actions[5:]), play(other, actions[5:])))

    def get_state(self) -> dict[str, np.ndarray]:
        """What can be read of every body, what it observes, and where the random numbers stand."""
        taken = json.dumps([snapshot.take(env) for env in self.envs])
        return {
            "bodies": np.frombuffer(taken.encode(), dtype=np.uint8).copy(),
            "current": self._current.copy(),
            "random": np.array([self._seed, self._draws], dtype=np.uint64),
        }

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Continues from what `get_state` returned, bit for bit where `exact_restore`."""
        if state.keys() != {"bodies", "current", "random"} or (
            np.shape(state["current"]) != self._current.shape
        ):
            raise EverystateError(f"the state does not belong to {self.num_envs} x {self.name}")
        saved = json.loads(state["bodies"].tobytes())
        for env, one in zip(self.envs, saved, strict=True):
            snapshot.put(env, one)
        self._current[:] = state["current"]
        self._seed, self._draws = (int(n) for n in state["random"])

    def get_physics(self) -> list[Physics]:
        """What can be read of each body, and what it observes."""
        return [
            {"snapshot": snapshot.take(env), "observation": current.tolist()}
            for env, current in zip(self.envs, self._current, strict=True)
        ]

    def set_physics(
        self, states: Sequence[Physics], which: Bool[np.ndarray, " envs"] | None = None
    ) -> None:
        """Gives bodies such snapshots."""
        ids = np.flatnonzero(np.ones(self.num_envs) if which is None else which)
        if len(states) != len(ids):
            raise EverystateError(
                f"{len(states)} physics states for {len(ids)} x {self.name}: give one each"
            )
        for state in states:
            if set(state) != {"snapshot", "observation"} or (
                len(state["observation"]) != self._flatten.size
            ):
                raise EverystateError(
                    f"a physics state of {self.name} has a snapshot and an observation of"
                    f" {self._flatten.size} numbers, as get_physics returns them"
                )
        for i, state in zip(ids, states, strict=True):
            snapshot.put(self.envs[i], state["snapshot"])
            self._current[i] = state["observation"]

    def set_observations(self, observations: Float[np.ndarray, "envs state"]) -> None:
        """Impossible: what such a body observes need not be all there is to its state."""
        raise EverystateError(
            f"{self.name} cannot be put into a state by what it observes: only reset it"
        )

    def render_states(
        self,
        observations: Float[np.ndarray, "steps state"],
        goal: Float[np.ndarray, "*steps state"] | None = None,
        width: int = 320,
        height: int = 240,
        along: Along | None = None,
    ) -> UInt8[np.ndarray, "steps height width 3"]:
        """Impossible, for the same reason; `render` draws the bodies as they stand."""
        raise EverystateError(f"{self.name} cannot be drawn from what it observed, only live")

    def render(self) -> tuple[UInt8[np.ndarray, "height width 3"], ...] | None:
        """One picture of each body as it stands now, by the environment itself."""
        if self.render_mode is None:
            return None
        try:
            with headless():
                return tuple(np.asarray(env.render()) for env in self.envs)
        except gymnasium.error.DependencyNotInstalled as error:
            raise EverystateError(f"drawing {self.name} needs {EXTRA} ({error})") from error

    def close_extras(self, **kwargs: Any) -> None:
        """Closes every body."""
        for env in self.envs:
            env.close()

    def _winds(
        self, env: gymnasium.Env, model: mujoco.MjModel, data: mujoco.MjData
    ) -> Bool[np.ndarray, " numbers"]:
        """Which numbers of an observation are the angle of a hinge without limits: tried out."""
        hinges = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
        free = model.jnt_qposadr[hinges & (model.jnt_limited == 0)]
        rng, seen, angles = np.random.default_rng(0), [], []
        observation, _ = env.reset(seed=0)
        for _ in range(_TRIED):
            seen.append(self._flatten.numbers(observation))
            angles.append(data.qpos[free].copy())
            action = self._scale(rng.uniform(-1, 1, self._scale.size))
            observation, _, ended, cut, _ = env.step(action)
            if ended or cut:
                observation, _ = env.reset()
        alike = np.isclose(np.stack(seen)[:, :, None], np.stack(angles)[:, None], atol=1e-6)
        return alike.all(axis=0).any(axis=-1) & (np.ptp(seen, axis=0) > 0)

    def _start(self, which: Bool[np.ndarray, " envs"]) -> None:
        seeds = self._rng().integers(2**31, size=self.num_envs).tolist()
        for i in np.flatnonzero(which):
            self._current[i] = self._flatten(self.envs[i].reset(seed=seeds[i])[0])

    def _advance(self, actions: Float[np.ndarray, "envs action"]) -> Bool[np.ndarray, " envs"]:
        ended = np.zeros(self.num_envs, dtype=bool)
        for i, (env, action) in enumerate(zip(self.envs, actions, strict=True)):
            observation, _, terminated, truncated, _ = env.step(self._scale(action))
            self._current[i] = self._flatten(observation)
            ended[i] = (terminated or truncated) and not self._goes_on
        return ended

    def _observe(self) -> Float[np.ndarray, "envs state"]:
        return self._current.copy()

    def _measurable(self) -> BodyVectorEnv:
        return GymnasiumVectorEnv(self.name, 5, 0, **self._kwargs)
