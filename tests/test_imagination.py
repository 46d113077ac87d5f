"""Steps that the policy imagines [D25]: in a world so simple that they can be counted by hand."""

import math
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flowjax.distributions import Normal

from everystate.learning.imagination import climbed as climbed_by
from everystate.learning.imagination import counted as counted_by
from everystate.learning.imagination import imagined, way_of
from everystate.learning.objectives import Hit, objectives
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


def way(config, acts, models=None, floor=NO_FLOOR, towards=value, pairs=2, aim=None):
    """What both functions are given before states and goals."""
    aim = aim or objectives(config, floor)[0]
    return aim, way_of(config, models or world(), acts, towards, aim, pairs)


def ways(config, gain, states=STATES, goals=GOALS):
    return imagined(config, *way(config, policy(gain)), states, goals, key=jax.random.key(0))


def counted(config, gain, states=STATES, goals=GOALS):
    """Where V learns, and what it is there."""
    aim = objectives(config, NO_FLOOR)[0]
    along = ways(config, gain, states, goals).states
    return counted_by(config, world(), value, aim, along, goals)


def climbed(config, gain, **world_and_floor):
    latents = jnp.zeros((len(STATES), config.imagined_steps, 2))
    return climbed_by(*way(config, policy(gain), **world_and_floor), STATES, GOALS, latents).mean()


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
    where, found = counted(config, 0.8)
    mean, summed = found[:, 0].mean(), by_hand(config, 0.8, steps, absorb=0)
    np.testing.assert_allclose(mean, by_hand(config, 0.8, steps, absorb=0.5), rtol=1e-4)
    np.testing.assert_allclose(climbed(config, 0.8), summed, rtol=1e-4)
    np.testing.assert_array_equal(where, STATES[:, None])


def test_the_value_learns_at_states_on_the_way_too():
    """At every second one, of what is counted from there on [D42]."""
    asked = {"imagined_steps": 5, "absorb": 0.5}
    everywhere, whole = counted(configured(**asked, value_stride=1), 0.8)
    where, found = counted(configured(**asked, value_stride=2), 0.8)
    assert everywhere.shape == (2, 5, 2)
    np.testing.assert_array_equal(where, everywhere[:, ::2])
    np.testing.assert_array_equal(found, whole[:, ::2])
    later = configured(imagined_steps=3, absorb=0.5)
    _, anew = counted(later, 0.8, states=everywhere[:, 2])
    np.testing.assert_allclose(found[:, 1], anew[:, 0], rtol=1e-5)


def test_hits_are_counted_on_the_ways_of_what_holds():
    """gamma^t h_t at the best of their steps, or what comes after them, whichever is more."""
    config = configured(imagined_steps=6)
    along, hit = ways(config, 0.8).states, Hit(config)
    for last, after in ((-50.0, 0.0), (50.0, 0.9**6)):
        _, found = counted_by(config, world(), lambda s, g, x=last: jnp.array(x), hit, along, GOALS)
        near = np.exp(-config.k * ((np.array(along) - np.array(GOALS)[:, None]) ** 2).sum(axis=-1))
        best = (near * 0.9 ** np.arange(7)).max(axis=1)
        np.testing.assert_allclose(found[:, 0], np.maximum(best, after), rtol=1e-4)


@pytest.mark.parametrize(
    ("how", "rank"),
    [({"percentile": 0.0}, 0), ({"percentile": 50.0}, 4), ({"percentile": 100.0}, 8)],
)
def test_of_many_ways_the_worst_is_climbed(how, rank):
    """Or that of the percentile asked for (eq. 3)."""
    config = configured(imagined_steps=4, N=9, **how)
    noisy = world(lambda s, a: Normal(s + STEP * a, jnp.full(2, 0.3)))
    key = jax.random.key(0)
    known = way(config, policy(0.8), models=noisy, aim=Hit(config))
    found = imagined(config, *known, STATES, GOALS, key=key)
    drawn = jax.random.normal(key, (2, 9, 4, 2))
    each = [climbed_by(*known, STATES, GOALS, drawn[:, i]) for i in range(9)]
    expected = jnp.sort(jnp.stack(each), axis=0)[rank]
    np.testing.assert_allclose(climbed_by(*known, STATES, GOALS, found.worst), expected, rtol=1e-5)


def test_whoever_holds_climbs_any_way():
    config = configured(imagined_steps=4, N=9)
    np.testing.assert_array_equal(
        ways(config, 0.8).worst, jax.random.normal(jax.random.key(0), (2, 1, 4, 2))[:, 0]
    )


def test_its_gradient_leads_to_the_goal():
    slope = jax.grad(lambda gain: climbed(configured(imagined_steps=4), gain))
    assert float(slope(0.1)) > 0
    assert float(slope(-0.1)) > 0


@pytest.mark.parametrize("beyond", [-3.0, 3.0])
def test_a_policy_beyond_all_actions_is_led_back_but_no_further_out(beyond):
    def loss(action, goal):
        def acts(s, g):
            return jnp.full_like(s, action)

        pair = jnp.zeros((1, 2)), jnp.full((1, 2), goal)
        known = way(configured(imagined_steps=2), acts, pairs=1)
        return -climbed_by(*known, *pair, jnp.zeros((1, 2, 2))).mean()

    slope = jax.grad(loss)
    assert slope(beyond, -beyond) * beyond > 0
    assert slope(beyond, beyond) == 0


def test_an_action_gains_so_much_and_no_more():
    """A slope of V a thousand times as steep moves the policy no more than `steepest` [D41]."""
    weight, pairs = 50.0, 4

    def slope(steepest, steep):
        config = configured(imagined_steps=1, imagined_weight=weight, steepest=steepest, k=1e6)
        states, goals = jnp.zeros((pairs, 2)), jnp.ones((pairs, 2))

        def loss(actions):
            def acts(s, g):
                return actions + 0 * s

            def cliff(s, g):
                return steep * value(s, g)

            latents = jnp.zeros((pairs, 1, 2))
            known = way(config, acts, towards=cliff, pairs=pairs)
            return -weight * climbed_by(*known, states, goals, latents).mean()

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
