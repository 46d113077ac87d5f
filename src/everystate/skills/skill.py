"""A skill is a goal that is kept, or a few that follow one another, and a rule that tells success.

Rules look at the states that were recorded on the way, in the body's own units.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

States = Float[np.ndarray, "steps starts state"]
At = Callable[[States], Bool[np.ndarray, "steps starts"]]
Rule = Callable[[States], Bool[np.ndarray, " starts"]]
Starts = Callable[[np.random.Generator, int], Float[np.ndarray, "starts state"]]
Goal = tuple[float, ...] | Mapping[str, float]
"""A whole state, or what is asked of it by the names of components and features."""


@dataclass(frozen=True)
class Skill:
    """What to ask for and how to tell whether it was done."""

    text: str
    goals: tuple[Goal, ...]
    """To reach one after the other, each for an equal share of the steps."""
    steps: int
    """Control steps in all."""
    starts: Starts
    done: Rule
    """Of states [steps + 1, starts, state], which starts led to success; of fewer, did already."""
    may_fall: bool = True
    """Whether a fall on the way (`falls` of the body) still counts."""

    @property
    def whole(self) -> bool:
        """Whether it asks for whole states, as any agent can be sent to."""
        return not any(isinstance(goal, Mapping) for goal in self.goals)

    def goal(self, step: int) -> Goal:
        """The goal at a step; the last one is kept."""
        return self.goals[min(step * len(self.goals) // self.steps, len(self.goals) - 1)]


def held(at: At, steps: int) -> Rule:
    """For so many steps in a row, at any time."""

    def rule(states: States) -> Bool[np.ndarray, " starts"]:
        inside = np.concatenate([np.zeros((1, states.shape[1]), bool), at(states)])
        total = inside.cumsum(axis=0)
        return (total[steps:] - total[:-steps] == steps).any(axis=0)

    return rule


def kept(at: At, steps: int) -> Rule:
    """At each of the last so many steps, of at least as many."""
    return lambda states: np.asarray(at(states)[-steps:].all(axis=0) & (len(states) >= steps))


def once(at: At) -> Rule:
    """At any one step."""
    return lambda states: np.asarray(at(states).any(axis=0))
