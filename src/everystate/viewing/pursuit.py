"""What a body was last asked for, since when, and whether it has been reached."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Float32

from everystate.agent import Agent, inputs
from everystate.envs import BodyVectorEnv
from everystate.evaluation import metrics
from everystate.goals import Goal, apart
from everystate.skills import Skill

REACHED = 0.5
"""σ from a goal, at which it counts as reached, as in the evaluations."""


def distance(
    agent: Agent, states: Float[np.ndarray, "steps state"], goal: Goal
) -> Float[np.ndarray, " steps"]:
    """σ from goals: of what is furthest of what is asked, or the rms of more than 12.

    Of several goals, one for each state, all ask for the same components.
    """
    spread = np.asarray(agent.scale.spread)
    pairs = inputs.pairs(states, goal, agent.state_names)
    off = apart(pairs.states, pairs.goals, agent.state_names, spread)[:, None]
    measure = metrics.rms if metrics.chief(off.shape[-1]) == "rms" else metrics.largest
    return measure(off, np.ones((1, off.shape[-1])))[:, 0]


@dataclass
class Pursuit:
    """A goal, or a skill by its name, and the way of the body since."""

    name: str
    skill: Skill | None
    states: list[Float32[np.ndarray, " state"]]
    """From where it began on, no more than the skill's steps."""
    steps: int = 0
    """Control steps since it was asked for."""
    reached: int | None = None
    """After how many the goal was first reached; of a skill, when its rule was last fulfilled."""
    planned: int = 0
    """Steps on which the agent searched ahead."""
    corrected: int = 0
    """Of these, those on which it found better than the policy."""
    _asked: int = field(default=0, repr=False)

    @property
    def over(self) -> bool:
        """Whether it has had its time; a goal has no end."""
        return self.skill is not None and self.steps >= self.skill.steps

    def goes_on(self, state: Float32[np.ndarray, " state"], distance: float) -> None:
        """A control step has led to a state, so many σ from the goal."""
        self.steps += 1
        if self.skill is not None:
            if self.steps <= self.skill.steps:
                self.states.append(state)
        elif self.reached is None and distance <= REACHED:
            self.reached = self.steps

    def judge(self, env: BodyVectorEnv) -> None:
        """Asks the skill's rule whether the way so far fulfils it; rules may take milliseconds."""
        if self.skill is None or len(self.states) == self._asked:
            return
        self._asked = len(self.states)
        recorded = np.stack(self.states)[:, None]
        done: Bool[np.ndarray, " 1"] = self.skill.done(recorded)
        if not self.skill.may_fall:
            done = done & ~env.falls(recorded[:-1], recorded[1:]).any(axis=0)
        if not done[0]:
            self.reached = None
        elif self.reached is None:
            self.reached = self._asked - 1

    def told(self, seconds: float) -> str:
        """In words, given the length of a control step."""
        if self.reached is not None:
            return f"{'done' if self.skill else 'reached'} in {self.reached * seconds:.1f} s"
        passed = self.steps * seconds
        if self.skill is None:
            return f"on its way, {passed:.1f} s"
        whole = self.skill.steps * seconds
        return f"not done in {whole:.1f} s" if self.over else f"{passed:.1f} of {whole:.1f} s"

    @property
    def search(self) -> str:
        """How often a search had another action than the policy, in words; empty without one."""
        if not self.planned:
            return ""
        return f"planning corrects {100 * self.corrected / self.planned:.0f} % of its steps"
