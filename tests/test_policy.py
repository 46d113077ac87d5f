"""Safe policy improvement (4.3): where the best action is known, and what pessimism changes."""

from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flowjax.distributions import Normal

from everystate.config import Config
from everystate.learning import policy
from everystate.learning.objectives import objectives
from everystate.learning.policy import improve, score
from small import of_paper
from worlds import Known

# Two sizes for all tests, so that each operation compiles twice at most.
FEW, MANY = {"j": 20, "N": 5}, {"j": 500, "N": 20}


def configured(**fields: Any) -> Config:
    """A reward so wide that it is 0 everywhere, which leaves V_targ alone; and these fields."""
    defaults = {"reward_space": "state", "k": 1e-6, "bound_value": False, "absorb": 0.0}
    for name, value in defaults.items():
        fields.setdefault(name, value)
    return of_paper(**fields)


def models(dynamics, policy=None):
    """Known dynamics, and a policy that is spread over and beyond the box of actions."""
    spread = Normal(jnp.zeros(2), jnp.full(2, 2.0))
    return SimpleNamespace(
        state_flow=Normal(jnp.zeros(2)),
        dynamics=Known(dynamics),
        policy=policy or (lambda *_: spread),
    )


def scored(monkeypatch, config, models, value, state, goal, key):
    """The improvement, with the returns [candidates, N] that it came from."""
    seen = []

    def watched(config, returns):
        seen.append(np.asarray(returns))
        return score(config, returns)

    monkeypatch.setattr(policy, "score", watched)
    monkeypatch.setattr(policy, "best_worst_case", best_by_all_returns)
    result = improved(config, models, value, state, goal, key)
    assert np.all(np.abs(result.action) <= 1)
    return result, seen[0][0]


def improved(config, models, value, state, goal, key):
    """Of one state and one goal."""
    key, (aim,) = jax.random.key(key), objectives(config)
    pair = state[None], goal[None]
    result = improve(config, models, models.policy, value, aim, *pair, key=key)
    return jax.tree.map(lambda x: x[0], result)


def best_by_all_returns(evaluate, next_states, goals):
    """What `best_worst_case` finds by fewer evaluations: see test_search.py."""
    pairs, candidates, N, size = next_states.shape
    returns = evaluate(next_states.reshape(pairs, -1, size), goals).reshape(pairs, candidates, N)
    best = policy.score(of_paper(), returns).argmax(axis=1)
    return best, returns[jnp.arange(pairs), best].mean(axis=1), jnp.ones(pairs)


B = jnp.array([[0.5, 0.2], [-0.1, 0.4]])
Q = 0.5 * jnp.linalg.inv(B @ B.T)


def linear(sd):
    """s' = s + B a + sd noise."""
    return lambda state, action: Normal(state + B @ action, jnp.full(2, sd))


def quadratic(state, goal):
    """V(s, g) = -(s - g)^T Q (s - g)."""
    return -(state - goal) @ Q @ (state - goal)


@pytest.mark.parametrize("pessimism", ["percentile", "mean"])
def test_improvement_finds_the_known_best_action(monkeypatch, pessimism):
    state, best = jnp.array([0.3, -0.2]), jnp.array([0.6, -0.4])
    goal = state + B @ best
    # B^T Q B = I / 2, so that a + grad lands on the best action from anywhere.
    known = models(linear(1e-4))
    config = configured(**FEW, pessimism=pessimism, max_gradient_step=10.0)
    result, _ = scored(monkeypatch, config, known, quadratic, state, goal, key=0)
    np.testing.assert_allclose(result.action, best, atol=2e-3)
    assert float(result.value) == pytest.approx(0, abs=1e-3)
    # Without gradients, candidates must lie near it by chance.
    config = configured(**MANY, pessimism=pessimism, max_gradient_step=0.0)
    result, _ = scored(monkeypatch, config, models(linear(0.01)), quadratic, state, goal, key=1)
    np.testing.assert_allclose(result.action, best, atol=0.15)


def test_improvement_stays_within_the_box(monkeypatch):
    goal = B @ jnp.array([5.0, -5.0])
    config = configured(**FEW, max_gradient_step=1.0)
    result, _ = scored(
        monkeypatch, config, models(linear(0.01)), quadratic, jnp.zeros(2), goal, key=2
    )
    np.testing.assert_allclose(result.action, [1, -1], atol=1e-5)


def test_random_candidates_fill_the_box():
    config, known = configured(**MANY, max_gradient_step=0.0), models(linear(0.01))
    from_world = known.dynamics, known.policy, quadratic
    propose = jax.jit(lambda key: policy.propose(config, *from_world, B[0], B[1], key=key))
    candidates, next_states = propose(jax.random.key(3))
    assert candidates.shape == (2000, 2)
    assert next_states.shape == (2000, 20, 2)
    at_random = np.asarray(candidates[500:1000])
    np.testing.assert_allclose(at_random.min(axis=0), -1, atol=0.05)
    np.testing.assert_allclose(at_random.max(axis=0), 1, atol=0.05)
    np.testing.assert_allclose(at_random.mean(axis=0), 0, atol=0.1)
    np.testing.assert_array_equal(candidates[1000:], candidates[:1000])  # by no step at all


def test_the_worst_is_the_minimum_and_percentiles_are_monotone():
    returns = jnp.asarray(np.random.default_rng(0).normal(0, 3, (7, 20)), jnp.float32)
    percentiles = (0.0, 1.0, 5.0, 25.0, 50.0, 90.0, 100.0)
    scores = np.stack([score(of_paper(percentile=p), returns) for p in percentiles])
    np.testing.assert_array_equal(scores[0], returns.min(axis=1))
    np.testing.assert_array_equal(scores[-1], returns.max(axis=1))
    assert np.all(np.diff(scores, axis=0) >= 0)
    mean = score(of_paper(pessimism="mean"), returns)
    np.testing.assert_array_equal(mean, returns.mean(axis=1))
    assert np.all(scores[0] <= mean)
    assert np.all(mean <= scores[-1])


def test_equal_candidates_share_their_noise_and_so_their_score(monkeypatch):
    # Without a gradient step the second half of the candidates repeats the first.
    config = configured(**FEW, max_gradient_step=0.0, sensor_noise=0.5)
    result, returns = scored(
        monkeypatch, config, models(linear(2.0)), quadratic, jnp.zeros(2), jnp.ones(2), key=3
    )
    assert returns.shape == (80, 5)
    np.testing.assert_array_equal(returns[:40], returns[40:])
    assert np.all(np.diff(returns, axis=1) != 0)  # But the N rollouts differ.
    assert float(result.value) == pytest.approx(returns[returns.min(axis=1).argmax()].mean())


def along(slope):
    """V = slope * first component: with s' = a, a return shows which action was tried."""
    return lambda state, goal: slope * state[0]


def moves_to_action(state, action):
    """s' = a, all but exactly."""
    return Normal(action, jnp.full(2, 1e-6))


@pytest.mark.parametrize("limit", [0.1, np.inf])
def test_candidates_move_along_their_gradient_within_the_limit(monkeypatch, limit):
    config, slope = configured(**FEW, max_gradient_step=limit), 0.3
    known = models(moves_to_action)
    _, returns = scored(monkeypatch, config, known, along(slope), jnp.zeros(2), jnp.zeros(2), key=4)
    candidates = returns[:, 0] / slope
    assert np.all(np.abs(candidates) <= 1 + 1e-4)
    before, after = candidates[:40], candidates[40:]
    assert np.any(np.isclose(before[:20], 1, atol=1e-4))  # Clipped samples of the policy.
    expected = np.minimum(before + min(limit, slope), 1)
    np.testing.assert_allclose(after, expected, atol=1e-4)


def test_pessimism_avoids_what_pays_only_on_average(monkeypatch):
    def risky(state, action):
        """The further to the right, the better on average and the worse at worst."""
        return Normal(action, 0.01 + 1.5 * jax.nn.relu(action))

    chosen: dict[str, float] = {}
    ways: dict[str, dict[str, Any]] = {
        "min": {"percentile": 0.0},
        "percentile": {"percentile": 5.0},
        "median": {"percentile": 50.0},
        "mean": {"pessimism": "mean"},
    }
    for name, fields in ways.items():
        config = configured(**MANY, **fields, max_gradient_step=0.0)
        known = models(risky)
        result, returns = scored(
            monkeypatch, config, known, along(1.0), jnp.zeros(2), jnp.zeros(2), key=5
        )
        chosen[name] = float(result.action[0])
        best = returns[score(config, jnp.asarray(returns)).argmax()]
        assert float(result.value) == pytest.approx(best.mean(), abs=1e-5)
    assert chosen["min"] == pytest.approx(0, abs=0.1)
    assert chosen["percentile"] == pytest.approx(0, abs=0.1)
    assert chosen["median"] > 0.8
    assert chosen["mean"] > 0.8


def test_it_says_whether_the_policy_knew_the_best_action(monkeypatch):
    state, best = jnp.zeros(2), jnp.array([0.5, 0.5])
    config = configured(**FEW, max_gradient_step=0.0)
    for action, knew in ((best, 1), (-best, 0)):
        known = models(linear(1e-4), lambda *_, a=action: Normal(a, jnp.full(2, 1e-3)))
        result, _ = scored(monkeypatch, config, known, quadratic, state, B @ best, key=6)
        assert float(result.from_policy) == knew
        assert 0 < float(result.off_support) < 2


def test_reaching_the_goal_is_what_pays():
    """With V_targ flat, the shaped reward alone leads to the goal (4.2)."""
    state, best = jnp.array([0.3, -0.2]), jnp.array([0.6, -0.4])
    config = configured(**MANY, k=10.0, max_gradient_step=0.5)
    flat = lambda state, goal: jnp.zeros(())  # noqa: E731
    result = improved(config, models(linear(1e-3)), flat, state, state + B @ best, key=7)
    np.testing.assert_allclose(result.action, best, atol=0.15)
    assert -0.05 < float(result.value) <= 0
