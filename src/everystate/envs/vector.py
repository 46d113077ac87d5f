"""Many copies of one body, stepped together and never reset unless asked: the part all share."""

import functools
import secrets
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from jaxtyping import Bool, Float, Float32, Shaped, UInt8

from everystate.envs.checks import checked_actions, checked_seed, require_finite
from everystate.envs.disturbance import Disturbance
from everystate.envs.rendering import Along
from everystate.envs.scaling import Scaling, scaling_of
from everystate.errors import EverystateError

Physics = dict[str, Any]
"""The state of one body as JSON can hold it: qpos and qvel, or a Gymnasium body's snapshot."""


class BodyVectorEnv(gymnasium.vector.VectorEnv, ABC):
    """A Gymnasium vector environment without reward or time limit.

    Observations are float32 `[num_envs, state]` in the units of `state_units`; actions lie in
    [-1, 1]. Arrays returned are the caller's own. Where a body can come to an end, it is put back
    to a start within the same step, as Gymnasium's `SAME_STEP` has it: `terminated` tells which,
    and `info["final_obs"]` has the observations before that.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "autoreset_mode": AutoresetMode.DISABLED,
        "render_modes": ["rgb_array"],
    }
    single_observation_space: Box
    single_action_space: Box
    observation_space: Box
    action_space: Box
    name: str
    source: str
    """Where the model came from."""
    state_names: tuple[str, ...]
    state_units: tuple[str, ...]
    action_names: tuple[str, ...]
    action_bounds: tuple[Float[np.ndarray, " action"], Float[np.ndarray, " action"]]
    """What the body takes for -1 and for 1, in its own units."""
    nominal: tuple[Sequence[float] | Float[np.ndarray, " state"], ...]
    """Centre and spread, NaN where they are to be measured."""
    control_step: float | None
    """Seconds of one step, if known."""
    model_hash: str = ""
    """Of the compiled model, undisturbed (`envs.model_copy`); "" of one that comes from a package
    by a Gymnasium id, which may make a new one each time."""
    horizontal: tuple[tuple[int, int], ...] = ()
    """Where in a state x and y of horizontal vectors lie, the way that the body faces first, if it
    does the same whichever way that is, turned with it: on level ground."""
    placeable: bool = True
    """Whether `set_observations` and `render_states` are possible."""
    exact_restore: bool = True
    """Whether `set_state` brings back all that decides the future."""

    def __init__(
        self,
        num_envs: int,
        seed: int | None,
        low: Sequence[float] | Float[np.ndarray, " state"],
        high: Sequence[float] | Float[np.ndarray, " state"],
        action_size: int,
        disturbance: Disturbance,
        render_mode: str | None,
    ) -> None:
        if num_envs < 1:
            raise EverystateError(f"num_envs is {num_envs}: at least one body is needed")
        if render_mode not in (None, "rgb_array"):
            raise EverystateError(f"render_mode is {render_mode!r}: choose 'rgb_array' or None")
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.disturbance = disturbance
        low, high = np.asarray(low, dtype=np.float32), np.asarray(high, dtype=np.float32)
        self.single_observation_space = Box(low, high)
        self.single_action_space = Box(-1.0, 1.0, shape=(action_size,), dtype=np.float32)
        self.action_names = tuple(f"action_{i}" for i in range(action_size))
        self.action_bounds = -np.ones(action_size), np.ones(action_size)
        self.observation_space = batched_box(self.single_observation_space, num_envs)
        self.action_space = batched_box(self.single_action_space, num_envs)
        self._never = np.zeros(num_envs, dtype=bool)
        self._seed, self._draws = secrets.randbits(63) if seed is None else checked_seed(seed), 0

    # --- What a kind of body has to say ---

    @abstractmethod
    def _start(self, which: Bool[np.ndarray, " envs"]) -> None:
        """Puts these bodies to new initial states."""

    @abstractmethod
    def _advance(self, actions: Float[np.ndarray, "envs action"]) -> Bool[np.ndarray, " envs"]:
        """One control step, under actions in [-1, 1]; returns which bodies came to an end."""

    @abstractmethod
    def _observe(self) -> Float[np.ndarray, "envs state"]:
        """The state of every body, without noise."""

    @abstractmethod
    def get_state(self) -> dict[str, np.ndarray]:
        """All that decides the future: the physics, and where the random numbers stand."""

    @abstractmethod
    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Continues from what `get_state` returned, bit for bit where `exact_restore`."""

    @abstractmethod
    def set_observations(self, observations: Float[np.ndarray, "envs state"]) -> None:
        """Puts the bodies into the given states, as if they had just been built there."""

    @abstractmethod
    def get_physics(self) -> list[Physics]:
        """The physics of each body on its own, as goal suites keep it; no random numbers."""

    @abstractmethod
    def set_physics(
        self, states: Sequence[Physics], which: Bool[np.ndarray, " envs"] | None = None
    ) -> None:
        """Puts bodies into states that `get_physics` returned, as if just built there.

        Those of `which`, or all of them, one state each; the others go on as they were.

        What it observes there is the same; what follows is too for MuJoCo bodies, whose solver
        starts afresh both times, and where `exact_restore` for others.

        Raises:
            EverystateError: there are more or fewer states than bodies, or of another kind.
        """

    @abstractmethod
    def render_states(
        self,
        observations: Float[np.ndarray, "steps state"],
        goal: Float[np.ndarray, "*steps state"] | None = None,
        width: int = 320,
        height: int = 240,
        along: Along | None = None,
    ) -> UInt8[np.ndarray, "steps height width 3"]:
        """Pictures of stored states; goals, one or one each, appear as translucent ghosts.

        `along` a path of states they are where the body has got to on it.
        """

    @abstractmethod
    def _measurable(self) -> "BodyVectorEnv":
        """Some bodies of this kind, undisturbed, to measure the scaling with."""

    # --- What follows ---

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32[np.ndarray, "envs state"], dict[str, Any]]:
        """New initial states for all bodies; a seed restarts the random numbers too."""
        if seed is not None:
            self._seed, self._draws = checked_seed(seed), 0
        self._start(~self._never)
        return self._sense(), {}

    def step(
        self, actions: Float[np.ndarray, "envs action"]
    ) -> tuple[
        Float32[np.ndarray, "envs state"],
        Float[np.ndarray, " envs"],
        Bool[np.ndarray, " envs"],
        Bool[np.ndarray, " envs"],
        dict[str, Any],
    ]:
        """One control step of every body, or `action_repeat` of them."""
        actions = checked_actions(actions, self.action_space.shape)
        if sigma := self.disturbance.action_noise:
            noise = self._rng().normal(0.0, sigma, actions.shape)
            actions = np.clip(actions + noise, -1.0, 1.0)
        ended = self._never
        for _ in range(self.disturbance.action_repeat):
            ended = self._advance(actions)
            if ended.any():
                break
        observations, info = self._sense(), {}
        if ended.any():
            info = {"final_obs": observations.copy(), "_final_obs": ended.copy()}
            self._start(ended)
            observations[ended] = self._sense()[ended]
        return observations, np.zeros(self.num_envs), ended.copy(), self._never.copy(), info

    def observe(self) -> Float32[np.ndarray, "envs state"]:
        """What each body observes now, sensor noise included; nothing moves."""
        return self._sense()

    def regions(self, observations: Float[np.ndarray, "*n state"]) -> Shaped[np.ndarray, "*n"]:
        """The name of the part of the world each state lies in."""
        return np.full(np.shape(observations)[:-1], "all")

    def scored(self, observations: Float[np.ndarray, "*n state"]) -> Float[np.ndarray, "*n scored"]:
        """What a success metric compares; a new array."""
        return np.array(observations)

    def falls(
        self, before: Float[np.ndarray, "*n state"], after: Float[np.ndarray, "*n state"]
    ) -> Bool[np.ndarray, "*n"]:
        """Which control steps from `before` to `after` were falls."""
        return np.zeros(np.shape(before)[:-1], dtype=bool)

    @functools.cached_property
    def scaling(self) -> Scaling:
        """Nominal where the body says so, else measured; the same at every call and seed."""
        return scaling_of(self.nominal, lambda: random_play(self._measurable(), steps=200))

    def _sense(self) -> Float32[np.ndarray, "envs state"]:
        observations = self._observe()
        require_finite(observations, self.state_names)
        if sigma := self.disturbance.sensor_noise:
            noise = self._rng().normal(0.0, sigma, observations.shape)
            observations = observations + noise * self.scaling.spread
        return observations.astype(np.float32)

    def _rng(self) -> np.random.Generator:
        """A fresh generator for each draw: two integers say where the random numbers stand."""
        self._draws += 1
        philox = np.random.Philox(key=[self._seed, 0], counter=[0, 0, self._draws, 0])
        return np.random.Generator(philox)


def batched_box(box: Box, num: int) -> Box:
    """The space of so many."""
    space = batch_space(box, num)
    assert isinstance(space, Box)
    return space


def random_play(
    env: BodyVectorEnv, steps: int, seed: int = 0
) -> Float32[np.ndarray, "steps envs state"]:
    """Observations under uniformly random actions, after a reset."""
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    size = (env.num_envs, *env.single_action_space.shape)
    return np.stack([env.step(rng.uniform(-1, 1, size))[0] for _ in range(steps)])
