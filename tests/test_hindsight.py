"""The peers of Stable-Baselines3 on our bodies (make test-peers)."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from everystate import envs, evaluation
from everystate.evaluation import suites
from everystate.peers.settings import SETTINGS
from everystate.studies import Terms, compare, rescore

pytestmark = pytest.mark.peers


def made(**how: Any) -> Any:
    """Four cartpoles."""
    from everystate.peers.goal_env import GoalVecEnv

    return GoalVecEnv(envs.make("cartpole", 4, 0), suites.load("cartpole"), seed=0, **how)


@pytest.fixture(scope="module")
def goal_env() -> Any:
    return made()


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


def test_without_resets_a_body_goes_on_from_where_it_is() -> None:
    goal_env = made(resets=False)
    first = goal_env.reset()
    for _ in range(goal_env.episode_steps - 1):
        goal_env.step(np.ones((4, 1)))
    observation, _, done, infos = goal_env.step(np.ones((4, 1)))
    assert done.all()
    for i, info in enumerate(infos):
        assert info["TimeLimit.truncated"]
        final = info["terminal_observation"]["observation"]
        np.testing.assert_array_equal(observation["observation"][i], final)
    assert (observation["desired_goal"] != first["desired_goal"]).any(axis=1).all()


def test_a_dense_reward_grows_towards_the_goal() -> None:
    suite, goal_env = suites.load("cartpole"), made(reward="dense")
    goal = suite.goals[[0] * 4]
    apart = np.array([0, 0.5, 1, 2])
    states = goal + apart[:, None] * suite.sigma
    rewards = goal_env.compute_reward(goal_env.scaled(states), goal_env.scaled(goal), {})
    np.testing.assert_allclose(rewards, np.exp(-(apart**2)) - 1, atol=1e-5)


@pytest.mark.parametrize("name", ["sac-her", "tqc-her", "sac-her-zoo", "tqc-her-zoo"])
def test_a_peer_acts_as_what_is_kept_of_it(name: str, tmp_path: Path) -> None:
    from everystate.peers.hindsight import HindsightAgent

    agent = HindsightAgent("ramp-pointmass", 0, name, SETTINGS[name])
    steps: list[int] = []
    agent.learn(3.0, lambda n, _: steps.append(n), 1.0)
    assert steps[-1] > 0
    suite = suites.load("ramp-pointmass")
    goals = suite.goals.astype(np.float32)
    starts = suite.begin(envs.make("ramp-pointmass", len(goals), 0), 0)
    asked = agent.act(starts, goals)
    np.testing.assert_allclose(agent.actor().act(starts, goals), asked, atol=1e-5)
    kept = agent.keep(tmp_path / "acting")
    assert 0 < np.abs(kept.act(starts, goals) - asked).max() < 0.01
    np.testing.assert_array_equal(
        kept.steps_to_goal(starts, goals), agent.steps_to_goal(starts, goals)
    )


@pytest.mark.parametrize("name", ["sac-her", "tqc-her", "tqc-her-zoo-push"])
def test_a_critic_tells_steps(name: str) -> None:
    from everystate.peers.hindsight import HindsightAgent

    agent = HindsightAgent("ramp-pointmass", 0, name, SETTINGS[name])
    goals = suites.load("ramp-pointmass").goals[:5]
    steps = agent.steps_to_goal(goals, goals[::-1])
    assert steps.shape == (5,)
    assert np.isfinite(steps).all()
    assert (np.abs(agent.act(goals, goals)) <= 1).all()
    assert evaluation.evaluate(agent, plan=False, episodes=5)["config"]["agent"] == name


def test_looks_at_a_peer_take_none_of_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    from everystate.peers import hindsight

    now, looked, steps = [0.0], [], 0

    def look(_: int, elapsed: float) -> None:
        looked.append(elapsed)
        now[0] += 100

    monkeypatch.setattr(hindsight.time, "perf_counter", lambda: now[0])
    clock = hindsight._Clock(3.0, look, 1.0)
    clock._on_training_start()
    while clock._on_step():
        now[0] += 0.25
        steps += 1
    assert looked == [0, 1, 2, 3]
    assert steps == 12


def test_a_peer_is_trained_and_compared(tmp_path: Path) -> None:
    terms = Terms("ramp-pointmass", minutes=0.3, preset="test", episodes=20, plan=False)
    agents = compare(terms, ["sac-her", "sac-her-no-reset"], 1, tmp_path / "out")["conditions"]
    assert list(agents) == ["sac-her", "sac-her-no-reset", "nothing", "random"]
    found = agents["sac-her"]
    assert found["steps"]["median"] > 0
    assert found["coverage"]["cells"]["median"] > 0
    assert "rest/all" in found["at_equal_steps"]
    again = rescore("ramp-pointmass", tmp_path / "out")["conditions"]
    for name, agent in agents.items():
        for what in ("score", "success", "closest"):  # not what its critic, which is not kept, says
            found = (one["suites"]["rest"]["policy"][what] for one in (again[name], agent))
            assert next(found) == next(found), (name, what)
