"""What an evaluation needs of an agent."""

from typing import Any, Protocol, runtime_checkable

import numpy as np

from everystate.config import Config


@runtime_checkable
class Agent(Protocol):
    """What an evaluation needs of an agent."""

    @property
    def config(self) -> Config: ...

    def act(
        self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0
    ) -> np.ndarray: ...

    def steps_to_goal(self, observation: Any, goal: Any) -> Any: ...
