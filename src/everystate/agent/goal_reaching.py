"""An agent as the low-level controller of whatever learns or decides above it."""

import math
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from gymnasium.utils import RecordConstructorArgs
from jaxtyping import Float
from numpy.typing import ArrayLike

from everystate.agent.agent import Agent
from everystate.errors import EverystateError


class GoalReaching(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """An environment in which one acts by saying where to be; an agent sees to how.

    An action is a goal: in each component of the agent's state, -1 to 1 stand for `reach` spreads
    below its centre to as many above (`agent.units`). It is a place and no offset from the present
    state: so a goal that is good stays good wherever the body is, and one constant action can be
    all that there is to learn. The agent goes for it for `steps` control steps, or until the
    episode ends. Their rewards are summed; observation and `info` are those after the last of them,
    and `info["goal"]` is the goal, in the units of the body.
    """

    def __init__(
        self,
        env: gymnasium.Env,
        agent: Agent,
        *,
        steps: int = 25,
        reach: float = 1.5,
        state: Callable[[Any], ArrayLike] | None = None,
    ) -> None:
        """Wraps an environment whose body is that of the agent.

        Args:
            env: takes the agent's actions, its bounds for -1 and 1.
            agent: acts by its policy.
            steps: control steps for which a goal is held.
            reach: how far goals go, in spreads; most states of the body should lie within.
            state: the agent's state [state] in an observation, by default all of it.

        Raises:
            EverystateError: steps or reach is no such number, or the agent does not fit the
                environment.
        """
        RecordConstructorArgs.__init__(
            self, _disable_deepcopy=True, agent=agent, steps=steps, reach=reach, state=state
        )
        super().__init__(env)
        if steps < 1:
            raise EverystateError(f"steps is {steps}: hold a goal for at least one")
        if not 0 < reach < math.inf:
            raise EverystateError(f"reach is {reach}: choose a number of spreads, as 1.5")
        takes, sees = env.action_space, env.observation_space
        if (
            not isinstance(takes, Box)
            or takes.shape != agent.action_space.shape
            or not takes.is_bounded()
        ):
            raise EverystateError(
                f"the environment takes {takes}: expected a bounded Box of the shape"
                f" {agent.action_space.shape}, for {', '.join(agent.action_names)}"
            )
        if state is None and sees.shape != agent.observation_space.shape:
            raise EverystateError(
                f"the environment gives {sees} and the agent's state has the shape"
                f" {agent.observation_space.shape}: give state=, a function from the one to the"
                f" other ({', '.join(agent.state_names)})"
            )
        self.agent, self.steps = agent, steps
        self.action_space = Box(-1.0, 1.0, agent.observation_space.shape, np.float32)
        self._state = state or (lambda observation: observation)
        self._low, self._high = takes.low, takes.high
        units = agent.units.values()
        self._centre = np.array([unit.centre for unit in units], np.float32)
        self._reach = np.array([reach * unit.spread for unit in units], np.float32)
        self._observation: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """A new episode."""
        self._observation, info = self.env.reset(seed=seed, options=options)
        return self._observation, info

    def step(
        self, action: Float[np.ndarray, " state"]
    ) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Goes for the goal; what lies beyond [-1, 1] is clipped.

        Raises:
            ResetNeeded: there was no `reset` yet.
        """
        if self._observation is None:
            raise ResetNeeded("call reset before step")
        goal = self._centre + np.clip(action, -1.0, 1.0).astype(np.float32) * self._reach
        total, ended, cut, info = 0.0, False, False, {}
        for _ in range(self.steps):
            acted = self.agent.act(self._state(self._observation), goal)
            signals = self._low + (acted + 1) / 2 * (self._high - self._low)
            self._observation, reward, ended, cut, info = self.env.step(signals)
            total += float(reward)
            if ended or cut:
                break
        return self._observation, total, ended, cut, {**info, "goal": goal}
