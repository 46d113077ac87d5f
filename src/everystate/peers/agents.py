"""What stands beside our agent in a comparison and learns nothing, as an evaluation wants it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float32

from everystate import envs


@dataclass(frozen=True)
class PeerConfig:
    """What the results of a peer say of it."""

    body: str
    body_options: tuple[str, ...]
    seed: int
    agent: str
    settings: dict[str, Any]
    """The fields of its `PeerSettings`; empty for one that does not learn."""


class RandomActions:
    """Acts uniformly at random, whatever the goal."""

    def __init__(self, config: PeerConfig) -> None:
        self.config = config
        self._size = _action_size(config)

    def act(
        self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0
    ) -> Float32[np.ndarray, "*n action"]:
        shape = (*np.shape(observation)[:-1], self._size)
        rng = np.random.default_rng((self.config.seed, seed))  # each of its seeds has others
        return rng.uniform(-1, 1, shape).astype(np.float32)

    def steps_to_goal(self, observation: Any, goal: Any) -> Float32[np.ndarray, "*n"]:
        """It has no idea."""
        return np.full(np.shape(observation)[:-1], np.nan, dtype=np.float32)


class DoNothing:
    """Lets the body go where it goes by itself."""

    def __init__(self, config: PeerConfig) -> None:
        self.config = config
        self._size = _action_size(config)

    def act(
        self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0
    ) -> Float32[np.ndarray, "*n action"]:
        return np.zeros((*np.shape(observation)[:-1], self._size), dtype=np.float32)

    def steps_to_goal(self, observation: Any, goal: Any) -> Float32[np.ndarray, "*n"]:
        """It has no idea."""
        return np.full(np.shape(observation)[:-1], np.nan, dtype=np.float32)


def _action_size(config: PeerConfig) -> int:
    body = envs.make(config.body, 1, 0, **envs.parse_options(config.body_options))
    return body.single_action_space.shape[0]
