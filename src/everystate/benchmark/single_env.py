"""One body on its way to a goal of a suite, as Gymnasium's `make` builds it."""

from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from jaxtyping import Float, Float32, UInt8

from everystate.benchmark.vector_env import GoalVectorEnv, Reward
from everystate.evaluation.suites import Split

Observation = dict[str, Float32[np.ndarray, " _"]]


class GoalEnv(gymnasium.Env):
    """A `GoalVectorEnv` of one body, without its vector dimension."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(
        self,
        body: str,
        suite: str | Path,
        split: Split = "tune",
        reward: Reward = "sparse",
        render_mode: str | None = None,
    ) -> None:
        """Takes the arguments of `GoalVectorEnv`; `gymnasium.make` fills in `body` and `suite`."""
        self.vector = GoalVectorEnv(1, body, suite, split, reward, render_mode)
        self.render_mode = render_mode
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """The next task, or {"task": number} of `options`."""
        super().reset(seed=seed)
        return _one(*self.vector.reset(seed=seed, options=options))

    def step(
        self, action: Float[np.ndarray, " action"]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One control step; truncated at the task's horizon, never terminated."""
        observation, reward, _, truncated, info = self.vector.step(np.asarray(action)[None])
        observation, info = _one(observation, info)
        return observation, float(reward[0]), False, bool(truncated[0]), info

    def compute_reward(
        self,
        achieved_goal: Float[np.ndarray, "*n goal"],
        desired_goal: Float[np.ndarray, "*n goal"],
        info: Any = None,
    ) -> Float32[np.ndarray, "*n"]:
        """That of `GoalVectorEnv`: one goal or many, as hindsight experience replay asks for."""
        return self.vector.compute_reward(achieved_goal, desired_goal, info)

    def render(self) -> UInt8[np.ndarray, "height width 3"] | None:
        """A picture of the body, its goal a translucent ghost."""
        pictures = self.vector.render()
        return pictures[0] if pictures else None


def _one(
    observation: dict[str, Float32[np.ndarray, "1 _"]], info: dict[str, np.ndarray]
) -> tuple[Observation, dict[str, Any]]:
    """Those of the one body; numbers in `info` are Python's."""
    values = {name: found[0].item() for name, found in info.items()}
    return {name: found[0] for name, found in observation.items()}, values
