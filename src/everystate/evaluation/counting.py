"""How far an evaluation has got: it is counted where the agent acts, once each control step."""

from collections.abc import Callable
from typing import Any

import numpy as np

from everystate.evaluation.agents import Agent, AgentConfig

OnStep = Callable[[int, int, float], None]
"""Is called with the control steps done, how many there are in all, and the share of the work that
is done."""

PLANNED = 200
"""A step with planning takes about so many times as long as one without."""


class Counting:
    """An agent that does as another and counts how often it acted."""

    def __init__(self, agent: Agent, steps: dict[bool, int], on_step: OnStep) -> None:
        """`steps` is how often it will act, without planning (False) and with it (True)."""
        self._agent, self._on_step = agent, on_step
        self._steps, self._work = sum(steps.values()), steps[False] + PLANNED * steps[True]
        self._done = self._worked = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._agent, name)

    @property
    def config(self) -> AgentConfig:
        """The agent's."""
        return self._agent.config

    def act(self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0) -> np.ndarray:
        """The agent's action."""
        action = self._agent.act(observation, goal, plan=plan, seed=seed)
        self._done += 1
        self._worked += PLANNED if plan else 1
        self._on_step(self._done, self._steps, self._worked / self._work)
        return action

    def steps_to_goal(self, observation: Any, goal: Any) -> Any:
        """The agent's."""
        return self._agent.steps_to_goal(observation, goal)
