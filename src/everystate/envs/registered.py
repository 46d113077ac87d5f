"""Our bodies as Gymnasium finds them: `gymnasium.make` and `gymnasium.make_vec` build these."""

from typing import Any, ClassVar

import gymnasium
import numpy as np
from jaxtyping import Float, Float32, UInt8

from everystate.envs import BodyVectorEnv, make


def vector_env(num_envs: int, body: str, seed: int | None = None, **options: Any) -> BodyVectorEnv:
    """The vector entry point."""
    return make(body, num_envs, seed, **options)


class SingleEnv(gymnasium.Env):
    """One body, without its vector dimension."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(self, body: str, seed: int | None = None, **options: Any) -> None:
        self.vector = make(body, 1, seed, **options)
        self.render_mode = self.vector.render_mode
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32[np.ndarray, " state"], dict[str, Any]]:
        """A new initial state."""
        super().reset(seed=seed)
        observations, info = self.vector.reset(seed=seed, options=options)
        return observations[0], info

    def step(
        self, action: Float[np.ndarray, " action"]
    ) -> tuple[Float32[np.ndarray, " state"], float, bool, bool, dict[str, Any]]:
        """One control step; reward 0, and it never ends."""
        observations, _, _, _, info = self.vector.step(np.asarray(action)[None])
        return observations[0], 0.0, False, False, info

    def render(self) -> UInt8[np.ndarray, "height width 3"] | None:
        """A picture of the body as it stands now."""
        frames = self.vector.render()
        return np.asarray(frames[0]) if frames else None
