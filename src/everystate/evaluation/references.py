"""What has learned nothing, for an agent to stand beside: no action, and random actions."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32

from everystate import envs
from everystate.evaluation import suites
from everystate.evaluation.agents import AgentConfig
from everystate.evaluation.measure import measure
from everystate.evaluation.suite import Suite


class DoNothing:
    """Lets the body go where it goes by itself."""

    def __init__(self, config: AgentConfig) -> None:
        self.config = config
        body = envs.make(config.body, 1, 0, **envs.parse_options(config.body_options))
        self._size = len(body.action_names)

    def act(
        self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0
    ) -> Float32[np.ndarray, "*n action"]:
        return np.zeros((*np.shape(observation)[:-1], self._size), dtype=np.float32)

    def steps_to_goal(self, observation: Any, goal: Any) -> Float32[np.ndarray, "*n"]:
        """It has no idea."""
        return np.full(np.shape(observation)[:-1], np.nan, dtype=np.float32)


class RandomActions(DoNothing):
    """Acts uniformly at random, whatever the goal; each seed has actions of its own."""

    def __init__(self, config: AgentConfig, seed: int = 0) -> None:
        super().__init__(config)
        self._seed = seed

    def act(
        self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0
    ) -> Float32[np.ndarray, "*n action"]:
        shape = (*np.shape(observation)[:-1], self._size)
        rng = np.random.default_rng((self._seed, seed))
        return rng.uniform(-1, 1, shape).astype(np.float32)


def beside(suite: Suite, config: AgentConfig, seed: int = 0) -> dict[str, dict[str, Any]]:
    """What becomes of the tasks of a suite without an agent.

    Args:
        suite: the tasks.
        config: of the agent that they are to stand beside.
        seed: of the body's noise and of actions.

    Returns:
        `[name]` as in `measure`; the names are "random actions" and "doing nothing".
    """
    agents = {"random actions": RandomActions(config), "doing nothing": DoNothing(config)}
    return {name: measure(one, suite, plan=False, seed=seed) for name, one in agents.items()}


def references(result: Mapping[str, Any], config: AgentConfig) -> dict[str, dict[str, Any]]:
    """What becomes of the tasks of a result without an agent.

    Args:
        result: what `evaluate` returned; suites from files are left out.
        config: of the agent it was measured of.

    Returns:
        `[suite][name]` as in `beside`.
    """
    found: dict[str, dict[str, Any]] = {}
    known = suites.every(config.body, config.body_options)
    for name, one in result["suites"].items():
        if name in known:
            suite = suites.load(config.body, name, config.body_options, one["split"])
            found[name] = beside(suite.subset(one["tasks"]), config, result["seed"])
    return found
