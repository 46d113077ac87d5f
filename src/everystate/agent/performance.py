"""An agent that performs a named skill: one goal after the other, an action at a time."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float32
from numpy.typing import ArrayLike

from everystate.goals import Goal
from everystate.skills import Skill


def step_seed(seed: int, step: int) -> int:
    """A seed for each step: with the same one, planning would repeat its noise at every step."""
    return (seed * 100_003 + step) % 2**31  # what JAX takes for a seed without 64-bit integers


@runtime_checkable
class Actor(Protocol):
    """What can be sent to a goal."""

    def act(
        self, observation: ArrayLike, goal: Goal, *, plan: bool = False, seed: int = 0
    ) -> Float32[np.ndarray, "*n action"]: ...


@dataclass
class Performance:
    """Called with each observation in turn, it returns the next action; both may be batches."""

    agent: Actor
    skill: Skill
    plan: bool
    seed: int
    step: int = 0
    """Control steps done so far."""

    @property
    def goal(self) -> Goal:
        """Where it is going now."""
        goal = self.skill.goal(self.step)
        return goal if isinstance(goal, Mapping) else np.array(goal, dtype=np.float32)

    @property
    def over(self) -> bool:
        """Whether the skill has had its time; one may go on all the same."""
        return self.step >= self.skill.steps

    def __call__(self, observation: ArrayLike) -> Float32[np.ndarray, "*n action"]:
        """The next action."""
        seed = step_seed(self.seed, self.step)
        action = self.agent.act(observation, self.goal, plan=self.plan, seed=seed)
        self.step += 1
        return action
