"""The peers of Stable-Baselines3 on our bodies (make test-peers)."""

from pathlib import Path

import numpy as np
import pytest

from everystate import envs, evaluation
from everystate.evaluation import suites
from everystate.peers import Terms, compare
from everystate.peers.agents import PeerConfig

pytestmark = pytest.mark.peers


@pytest.fixture(scope="module")
def goal_env():
    from everystate.peers.goal_env import GoalVecEnv

    return GoalVecEnv(envs.make("cartpole", 4, 0), suites.load("cartpole"), seed=0)


def test_the_reward_is_what_an_evaluation_asks(goal_env) -> None:
    suite = suites.load("cartpole")
    goal = goal_env.scaled(suite.goals[:1])
    near, far = suite.goals[:1] + 0.49 * suite.sigma, suite.goals[:1] + 0.51 * suite.sigma
    assert goal_env.compute_reward(goal_env.scaled(near), goal, {}) == 0
    assert goal_env.compute_reward(goal_env.scaled(far), goal, {}) == -1


def test_an_episode_ends_in_a_reset_and_a_new_goal(goal_env) -> None:
    first = goal_env.reset()
    for _ in range(goal_env.episode_steps - 1):
        observation, _, done, _ = goal_env.step(np.zeros((4, 1)))
        assert not done.any()
        np.testing.assert_array_equal(observation["desired_goal"], first["desired_goal"])
    observation, _, done, infos = goal_env.step(np.zeros((4, 1)))
    assert done.all()
    assert (observation["desired_goal"] != first["desired_goal"]).any(axis=1).all()
    for i, info in enumerate(infos):
        assert info["TimeLimit.truncated"]
        final = info["terminal_observation"]
        np.testing.assert_array_equal(final["desired_goal"], first["desired_goal"][i])


@pytest.mark.parametrize("name", ["sac-her", "tqc-her"])
def test_a_critic_tells_steps(name: str) -> None:
    from everystate.peers.hindsight import SETTINGS, HindsightAgent

    agent = HindsightAgent(PeerConfig("ramp-pointmass", (), 0, name, SETTINGS))
    goals = suites.load("ramp-pointmass").goals[:5]
    steps = agent.steps_to_goal(goals, goals[::-1])
    assert steps.shape == (5,)
    assert np.isfinite(steps).all()
    assert (np.abs(agent.act(goals, goals)) <= 1).all()
    assert evaluation.evaluate(agent, plan=False, episodes=5)["config"]["agent"] == name


def test_a_peer_is_trained_and_compared(tmp_path: Path) -> None:
    terms = Terms("ramp-pointmass", minutes=0.3, preset="test", episodes=20, plan=False)
    found = compare(terms, ["sac-her"], 1, tmp_path / "out")["agents"]["sac-her"]
    assert found["steps"]["median"] > 0
    assert found["coverage"]["cells"]["median"] > 0
    assert "all" in found["at_equal_steps"]
