"""Steps that the policy imagines [D25]: in a world so simple that they can be counted by hand."""

import math
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flowjax.distributions import Normal

from everystate.learning.imagination import imagined
from everystate.learning.objectives import objectives
from small import of_paper
from worlds import Known

STEP, CERTAIN = 0.2, jnp.full(2, 1e-6)  # how far an action of 1 leads; no noise to speak of
STATES, GOALS = jnp.array([[0.0, 0.0], [1.0, -2.0]]), jnp.array([[2.0, 0.1], [1.0, 0.0]])
NO_FLOOR = jnp.array(-jnp.inf)


def world(dynamics=lambda s, a: Normal(s + STEP * a, CERTAIN)):
    return SimpleNamespace(state_flow=Normal(jnp.zeros(2)), dynamics=Known(dynamics))


def policy(gain):
    """Leads towards the goal."""
    return lambda s, g: gain * (g - s)


def value(s, g):
    return -3 * jnp.linalg.norm(s - g)


def configured(**fields):
    defaults = {"reward_space": "state", "k": 0.5, "discount": 0.9, "bound_value": False}
    return of_paper(**{**defaults, **fields})


def both(config, gain, models=None, floor=NO_FLOOR):
    models, key = models or world(), jax.random.key(0)
    aim, *_ = objectives(config, floor)
    returns = imagined(config, models, policy(gain), value, aim, STATES, GOALS, key=key)
    return returns._replace(climbed=returns.climbed.mean(), counted=returns.counted.mean(axis=0))


def climbed(*args, **kwargs):
    return both(*args, **kwargs).climbed


def by_hand(config, gain, steps, absorb):
    """The mean over both pairs, one step after the other."""
    totals = []
    for state, goal in zip(np.array(STATES, float), np.array(GOALS, float), strict=True):
        total, weight = 0.0, 1.0
        for _ in range(steps):
            state = state + STEP * np.clip(gain * (goal - state), -1, 1)
            near = np.exp(-config.k * ((state - goal) ** 2).sum())
            total += weight * (near - 1)
            weight *= config.discount * (1 - absorb * near)
        totals.append(total + weight * float(value(jnp.array(state), jnp.array(goal))))
    return np.mean(totals)


@pytest.mark.parametrize("steps", [1, 4])
def test_the_return_is_the_rewards_on_the_way_and_the_value_at_its_end(steps):
    config = configured(imagined_steps=steps, absorb=0.5)
    found = both(config, 0.8)
    counted = by_hand(config, 0.8, steps, absorb=0.5)
    np.testing.assert_allclose(found.counted[0], counted, rtol=1e-4)
    np.testing.assert_allclose(found.climbed, by_hand(config, 0.8, steps, absorb=0), rtol=1e-4)
    np.testing.assert_array_equal(found.states, STATES[:, None])


def test_the_value_learns_at_states_on_the_way_too():
    """At every second one, of what is counted from there on [D42]."""
    asked = {"imagined_steps": 5, "absorb": 0.5}
    whole = both(configured(**asked, value_stride=1), 0.8)
    found = both(configured(**asked, value_stride=2), 0.8)
    assert whole.states.shape == (2, 5, 2)
    np.testing.assert_array_equal(found.states, whole.states[:, ::2])
    np.testing.assert_array_equal(found.counted, whole.counted[::2])
    later = configured(imagined_steps=3, absorb=0.5)
    aim, *_ = objectives(later)
    begun = whole.states[:, 2]
    key = jax.random.key(0)
    anew = imagined(later, world(), policy(0.8), value, aim, begun, GOALS, key=key)
    np.testing.assert_allclose(found.counted[1], anew.counted.mean(), rtol=1e-5)


def test_its_gradient_leads_to_the_goal():
    slope = jax.grad(lambda gain: climbed(configured(imagined_steps=4), gain))
    assert float(slope(0.1)) > 0
    assert float(slope(-0.1)) > 0


@pytest.mark.parametrize("beyond", [-3.0, 3.0])
def test_a_policy_beyond_all_actions_is_led_back_but_no_further_out(beyond):
    def loss(action, goal):
        def acts(s, g):
            return jnp.full_like(s, action)

        key, config = jax.random.key(0), configured(imagined_steps=2)
        pair = jnp.zeros((1, 2)), jnp.full((1, 2), goal)
        aim, *_ = objectives(config)
        returns = imagined(config, world(), acts, value, aim, *pair, key=key)
        return -returns.climbed.mean()

    slope = jax.grad(loss)
    assert slope(beyond, -beyond) * beyond > 0
    assert slope(beyond, beyond) == 0


def test_an_action_gains_so_much_and_no_more():
    """A slope of V a thousand times as steep moves the policy no more than `steepest` [D41]."""
    weight, pairs = 50.0, 4

    def slope(steepest, steep):
        config = configured(imagined_steps=1, imagined_weight=weight, steepest=steepest, k=1e6)
        aim, *_ = objectives(config)
        states, goals = jnp.zeros((pairs, 2)), jnp.ones((pairs, 2))

        def loss(actions):
            def acts(s, g):
                return actions + 0 * s

            def cliff(s, g):
                return steep * value(s, g)

            key, known = jax.random.key(0), (config, world(), acts, cliff, aim)
            returns = imagined(*known, states, goals, key=key)
            return -weight * returns.climbed.mean()

        return float(jnp.linalg.norm(jax.grad(loss)(jnp.full(2, 0.1)))) / weight

    assert slope(10.0, 1.0) == pytest.approx(slope(math.inf, 1.0))
    assert slope(math.inf, 1000.0) > 100
    assert slope(10.0, 1000.0) == pytest.approx(10)


def test_the_value_is_held_within_its_bounds():
    config = configured(imagined_steps=1, bound_value=True, k=1e6)
    assert float(climbed(config, 0.0, floor=jnp.array(-2.0))) == pytest.approx(-1 - 0.9 * 2)


def test_dynamics_that_lead_nowhere_known_do_no_harm():
    """Early d multiply the state at each step, and the gradient with it, beyond all numbers."""
    wild = world(lambda s, a: Normal(1e9 * (s + a), CERTAIN))
    found = jax.value_and_grad(
        lambda gain: climbed(configured(imagined_steps=20), gain, models=wild)
    )(0.5)
    assert np.isfinite(found).all()
