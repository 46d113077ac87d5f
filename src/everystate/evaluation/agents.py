"""What an evaluation needs of an agent."""

import warnings
from dataclasses import Field
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from everystate.envs import BodyVectorEnv


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


def warn_of_another_model(agent: Agent, env: BodyVectorEnv) -> None:
    """Warns where a body's model is not what the agent learned on, as after an update of a package.

    It is no error: how an agent does on another body is a fair question, if one knows of it.
    """
    body = getattr(agent, "body", None)  # a peer does not say
    known, versions = getattr(body, "model_hash", ""), getattr(body, "versions", {})
    if known and env.model_hash and known != env.model_hash:
        warnings.warn(
            f"{env.name} is another model than the agent learned on (under {versions}): what"
            " follows is how it does on this one",
            stacklevel=3,
        )
