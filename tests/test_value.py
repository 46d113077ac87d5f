"""Targets of the value (eq. 2), and its learning where the number of steps is known."""

from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from everystate.learning.losses import value_loss
from everystate.learning.networks import Value, waves
from everystate.learning.objectives import objectives
from everystate.learning.rewards import closeness, placing
from everystate.learning.value import lowest, steps
from everystate.presets import preset
from small import of_paper

PLACES = 6


def backup(config, near, value, floor):
    """r + V_targ after one step."""
    return objectives(config, floor)[0].counted(jnp.stack([jnp.zeros(()), near]), value)[0]


def test_backup_is_the_reward_plus_the_value():
    def target(near, value, floor=-np.inf, **fields):
        config = of_paper(**fields)
        return float(backup(config, jnp.array(near), jnp.array(value), jnp.array(floor)))

    free = {"bound_value": False, "absorb": 0.0}
    assert target(0.0, -7.0, **free) == -8
    assert target(1.0, -7.0, **free) == -7
    assert target(0.25, -7.0, **free) == -7.75
    assert target(0.0, 100.0, -3.0, **free) == 99  # Nothing holds it, whatever the floor.
    assert target(0.0, -100.0, -3.0, **free) == -101

    absorbing = {"bound_value": False, "absorb": 1.0}
    assert target(0.0, -7.0, **absorbing) == -8
    assert target(1.0, -7.0, **absorbing) == 0
    assert target(0.25, -8.0, **absorbing) == -6.75

    for absorb in (0.0, 0.5, 1.0):
        bounded = {"bound_value": True, "absorb": absorb}
        assert target(0.0, -2.5, -3.0, **bounded) == -3.5
        for near in (0.0, 0.5, 1.0):
            for value in (-1e9, -1.0, 1e9):
                assert -4 <= target(near, value, -3.0, **bounded) <= 0
        assert target(1.0, 1e9, -3.0, **bounded) == 0


def test_a_discounted_backup_has_a_least_value_and_stands_for_steps():
    config = of_paper(discount=0.9, absorb=0.5)
    target = backup(config, jnp.array(0.5), jnp.array(-4.0), jnp.array(-9.0))
    assert float(target) == pytest.approx(-0.5 - 0.9 * 0.75 * 4)
    least, value = [], 0.0
    for copies in range(30):
        least.append(float(lowest(config, jnp.array(copies))))
        assert least[-1] == pytest.approx(value, abs=1e-5)
        value = float(backup(config, jnp.array(0.0), jnp.array(value), jnp.array(value)))
    np.testing.assert_allclose(steps(config, jnp.array(least)), np.arange(30.0), atol=1e-3)
    assert np.isfinite(steps(config, jnp.array([-11.0, 0.5]))).all()
    undiscounted = of_paper()
    assert float(lowest(undiscounted, jnp.array(7))) == -7
    assert float(steps(undiscounted, jnp.array([-7.0]))[0]) == 7


def test_closeness_is_one_at_the_goal_and_falls_with_k():
    here, there = jnp.array([0.1, 0.2]), jnp.array([0.2, 0.2])
    assert float(closeness(of_paper(k=100.0), here, here)) == 1
    assert float(closeness(of_paper(k=100.0), here, there)) == pytest.approx(np.exp(-1))
    assert float(closeness(of_paper(k=10.0), here, there)) == pytest.approx(np.exp(-0.1))


def test_of_two_slopes_one_leads_from_afar_by_what_is_slow_to_change() -> None:
    """Half of the closeness counts in states, with a cusp, half in steps [D45]."""
    models = SimpleNamespace(
        dynamics=SimpleNamespace(change_scale=jnp.array([0.1, 0.2]), weights=jnp.ones(2))
    )
    config = preset("quick")
    place, goal = placing(config, models), jnp.zeros(2)

    def near(*state: float) -> float:
        return float(closeness(config, place(jnp.array(state)), place(goal)))

    k = 1 / (2 * 0.3**2)
    assert near(0.0, 0.0) == 1
    for state, slow in (((1.5, 0.0), 1.5**2 * 1.6), ((0.0, 1.5), 1.5**2 * 0.4)):
        cusp = np.exp(0.1 - np.sqrt(k * 1.5**2 + 0.01))
        assert near(*state) == pytest.approx((cusp + 1 / (1 + slow / 2)) / 2)


def test_waves_are_sines_and_cosines_of_falling_amplitude() -> None:
    x = jnp.linspace(-5, 5, 101)
    octaves = [2**i for i in range(4)]
    direct = [wave(jnp.pi / 2 * o * x) / o for o in octaves for wave in (jnp.sin, jnp.cos)]
    np.testing.assert_allclose(jnp.stack(waves(x, 4)), jnp.stack(direct), atol=2e-5)
    assert waves(x, 0) == []


def scaled(place):
    """Where a place of the chain lies in scaled units."""
    return (place - (PLACES - 1) / 2)[..., None] / 2


def trained(config, copies, updates):
    """V(s, g) [place, goal] after so many target copies, each fitted to exact backups.

    The chain: one place to the left, to the right, or none, with walls at both ends.
    """
    value = Value(1, both=True, width=16, depth=2, frequencies=3, key=jax.random.key(0))
    states, goals = (x.ravel() for x in jnp.meshgrid(jnp.arange(6.0), jnp.arange(6.0)))
    adam = optax.adam(config.learning_rate)

    def returns(target_value, state, goal, floor):
        def after(move):
            next_state, goal_state = scaled(jnp.clip(state + move, 0, PLACES - 1)), scaled(goal)
            near = closeness(config, next_state, goal_state)
            return backup(config, near, target_value(next_state, goal_state), floor)

        return jnp.stack([after(move) for move in (-1, 0, 1)])

    def until_next_copy(carry, copy):
        arrays, _ = carry
        target = eqx.combine(arrays, static)
        floor = -(copy.astype(jnp.float32) + 1)
        targets = jax.vmap(lambda s, g: returns(target, s, g, floor).max())(states, goals)

        def once(carry, _):
            arrays, optimiser = carry

            def loss(arrays):
                new, pairs = eqx.combine(arrays, static), (scaled(states), scaled(goals))
                return value_loss(config, objectives(config)[0], new, *pairs, targets)

            gradient = jax.grad(loss)(arrays)
            change, optimiser = adam.update(gradient, optimiser)
            return (eqx.apply_updates(arrays, change), optimiser), None

        carry, _ = jax.lax.scan(once, carry, length=updates)
        learned = jax.vmap(eqx.combine(carry[0], static))(scaled(states), scaled(goals))
        return carry, learned

    arrays, static = eqx.partition(value, eqx.is_inexact_array)
    run = jax.jit(lambda carry: jax.lax.scan(until_next_copy, carry, jnp.arange(copies)))
    _, learned = run((arrays, adam.init(arrays)))
    return np.asarray(learned).reshape(copies, PLACES, PLACES)


@pytest.mark.parametrize("stabilised", [True, False])
def test_the_value_converges_to_the_known_step_counts(stabilised):
    config = of_paper(bound_value=stabilised, absorb=float(stabilised), k=30.0, learning_rate=3e-3)
    learned = trained(config, copies=10, updates=60)
    steps = np.abs(np.arange(PLACES)[:, None] - np.arange(PLACES))
    # The reward is that of s', so that the step onto the goal costs nothing: one place away, as
    # at the goal itself, the count is 0.
    known = -np.maximum(steps - 1.0, 0)
    np.testing.assert_allclose(learned[-1], known, atol=0.3)
    # Its horizon grows by one step a copy.
    for copy in range(4):
        assert learned[copy].min() == pytest.approx(-min(copy + 1, 4), abs=0.6)


def test_the_loss_adds_the_value_at_the_goals():
    config = of_paper(goal_value_weight=0.5)

    def value(state, goal):
        return state[0] - 2 * goal[0]

    states, goals = jnp.array([[1.0], [3.0]]), jnp.array([[0.0], [2.0]])
    targets = jnp.array([0.0, 1.0])
    loss = value_loss(config, objectives(config)[0], value, states, goals, targets)
    errors, at_goals = np.array([1.0, -2.0]), np.array([0.0, -2.0])
    assert float(loss) == pytest.approx((errors**2).mean() + 0.5 * (at_goals**2).mean())


def test_relative_errors_count_less_where_there_is_far_to_go():
    states, goals = jnp.array([[1.0], [-30.0]]), jnp.zeros((2, 1))
    config = of_paper(goal_value_weight=0.0, relative_errors=True)
    targets, aim = jnp.array([0.0, -39.0]), objectives(config)[0]
    loss = value_loss(config, aim, lambda s, g: s[0] - 2 * g[0], states, goals, targets)
    assert float(loss) == pytest.approx((1.0 / (1 + 0) + 81.0 / (1 + 39)) / 2)
