"""Bodies that a test knows all about."""

from typing import Any

import gymnasium
import numpy as np

STEP = 0.1
"""The most that a step changes a place by."""
LENGTH = 20
"""Steps from one end to the other."""


class Chain(gymnasium.Env):
    """A place between two walls, `LENGTH` steps apart, that a step moves by a tenth of its action.

    It starts at the left wall, so that a goal `n` steps from there takes at least `n`.
    """

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float64)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    render_mode = None

    def __init__(self, render_mode: str | None = None) -> None:
        self._x = -1.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self._x = -1.0
        return np.array([self._x]), {}

    def step(self, action: Any):
        self._x = float(np.clip(self._x + STEP * float(action[0]), -1.0, 1.0))
        return np.array([self._x]), 0.0, False, False, {}


class Marked(Chain):
    """That place, and a number that each episode has of its own."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float64)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        place, info = super().reset(seed=seed)
        self._mark = self.np_random.uniform(-1, 1)
        return np.array([*place, self._mark]), info

    def step(self, action: Any):
        place, reward, ended, cut, info = super().step(action)
        return np.array([*place, self._mark]), reward, ended, cut, info


_entries: dict[str, Any] = {"Chain-v0": Chain, "Marked-v0": Marked}
for _name, _entry in _entries.items():
    gymnasium.register(_name, _entry)
