"""An agent under other code: what it is told, what it does, and what that brings."""

import warnings
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Discrete, Space
from gymnasium.utils.env_checker import check_env

import everystate
import everystate.benchmark
from everystate import Agent, GoalReaching, envs
from everystate.errors import EverystateError


@pytest.fixture(scope="module")
def agent() -> Agent:
    return everystate.load("ramp-pointmass")


class Written(gymnasium.Env):
    """Writes down what it is told; its third step brings 3 and is the last."""

    action_space: Space = Box(np.array([0.0, -2.0], np.float32), np.array([4.0, 2.0], np.float32))
    observation_space: Space = Box(-np.inf, np.inf, (2,))
    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(self) -> None:
        self.told: list[np.ndarray] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.told = []
        return self._observed(), {}

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.told.append(action)
        count = len(self.told)
        return self._observed(), float(count), count == 3, False, {"count": count}

    def _observed(self) -> Any:
        return np.array([0.1 * len(self.told), -0.5], np.float32)


def test_a_goal_is_held_and_what_it_brings_is_summed(agent: Agent) -> None:
    written = Written()
    env = GoalReaching(written, agent, steps=2, reach=2.0)
    first, _ = env.reset(seed=0)
    units = agent.units
    goal = [units["x"].centre + units["x"].spread, units["y"].centre - 2 * units["y"].spread]
    observation, reward, ended, cut, info = env.step(np.array([0.5, -1.0]))
    assert (reward, ended, cut, info["count"]) == (1 + 2, False, False, 2)
    np.testing.assert_allclose(info["goal"], goal, rtol=1e-6)
    assert observation[0] == pytest.approx(0.2)
    acted = agent.act([first, [0.1, -0.5]], goal)
    np.testing.assert_allclose(written.told, [[2.0, 0.0]] + 2 * acted, rtol=1e-5, atol=1e-6)
    _, reward, ended, _, info = env.step(np.array([7.0, -1.0]))  # beyond is clipped
    assert (reward, ended, info["count"]) == (3, True, 3)
    assert info["goal"][0] == pytest.approx(units["x"].centre + 2 * units["x"].spread)


def test_it_leads_to_where_it_is_sent(agent: Agent) -> None:
    env = GoalReaching(gymnasium.make("everystate/RampPointmass-v0"), agent, steps=40)
    env.reset(seed=0)
    there = np.array([-0.5, 0.3], np.float32)
    observation, _, _, _, info = env.step(there)
    assert np.abs(observation - info["goal"]).max() < 0.15


@pytest.mark.parametrize("id", ["everystate/RampPointmass-v0", "everystate/RampPointmassRest-v1"])
def test_gymnasium_finds_nothing_wrong(agent: Agent, id: str) -> None:
    assert envs.BODIES  # registers the first
    inner = gymnasium.make(id, max_episode_steps=6)
    state = (lambda x: x["observation"]) if id.endswith("1") else None
    env = GoalReaching(inner, agent, steps=4, state=state)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r".*is different from the unwrapped version")
        warnings.filterwarnings("ignore", r".*A Box observation space m\w+ value is -?infinity")
        check_env(env, skip_render_check=True)
    assert env.spec is not None
    again, action = env.spec.make(), np.array([0.2, 0.1], np.float32)
    np.testing.assert_equal(again.reset(seed=3), env.reset(seed=3))
    np.testing.assert_equal(again.step(action), env.step(action))


def test_what_does_not_fit_is_named(agent: Agent) -> None:
    with pytest.raises(EverystateError, match="steps is 0"):
        GoalReaching(Written(), agent, steps=0)
    for reach in (0.0, float("inf"), float("nan")):
        with pytest.raises(EverystateError, match=f"reach is {reach}"):
            GoalReaching(Written(), agent, reach=reach)
    for space in (Discrete(2), Box(-1.0, 1.0, (3,)), Box(-np.inf, np.inf, (2,))):
        env = Written()
        env.action_space = space
        with pytest.raises(EverystateError, match=r"takes .* bounded Box of the shape \(2,\)"):
            GoalReaching(env, agent)
    env = Written()
    env.observation_space = Box(-1.0, 1.0, (3,))
    with pytest.raises(EverystateError, match=r"give state=, a function .* \(x, y\)"):
        GoalReaching(env, agent)
    with pytest.raises(ResetNeeded, match="reset before"):
        GoalReaching(Written(), agent).step(np.zeros(2))
