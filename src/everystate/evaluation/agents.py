"""What an evaluation needs of an agent."""

from dataclasses import Field
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class AgentConfig(Protocol):
    """What an evaluation needs of its config, a dataclass: all of it goes into the results."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def body(self) -> str: ...

    @property
    def body_options(self) -> tuple[str, ...]: ...


@runtime_checkable
class Agent(Protocol):
    """What an evaluation needs of an agent."""

    @property
    def config(self) -> AgentConfig: ...

    def act(
        self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0
    ) -> np.ndarray: ...

    def steps_to_goal(self, observation: Any, goal: Any) -> Any: ...
