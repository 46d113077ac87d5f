"""Units that grow with the body [D33], and averages of the weights [D35]."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from everystate import algorithm
from everystate.learning.averages import averaged
from everystate.learning.models import Space
from everystate.learning.replay import Transitions
from everystate.learning.state import AgentState
from everystate.learning.units import grown, of_warm_up
from everystate.presets import preset

CONFIG = preset("test", "no-such-body", num_bodies=10, warmup_steps=20, capacity=4_000)


def walk(spread, steps=20):
    """Transitions [steps, bodies, ...] of two components with these spreads."""
    keys = jax.random.split(jax.random.key(1), 3)
    shape = steps, CONFIG.num_bodies, 2
    about = jnp.broadcast_to(jnp.array([5.0, -3.0]), shape)
    states = spread * jax.random.normal(keys[0], shape) + about
    changed = states + 0.1 * spread * jax.random.normal(keys[1], shape)
    actions = jax.random.uniform(keys[2], (*shape[:2], 1), minval=-1, maxval=1)
    return Transitions(states, actions, changed, states)


def begun(spread=1.0) -> AgentState:
    warmup = walk(spread)
    scale = of_warm_up(warmup.next_observations)
    return algorithm.init(CONFIG, Space(2, 1), warmup, scale, key=jax.random.key(0))


def in_body_units(state: AgentState, states):
    return np.asarray(state.scale.unscaled(states))


def test_a_new_default_has_running_units_and_an_average():
    assert CONFIG.units == "running"
    assert CONFIG.averaged > 0


def test_units_of_a_warm_up_are_its_spread_and_one_where_nothing_moved():
    states = jnp.stack([jnp.linspace(-1, 1, 50), jnp.full(50, 1e6), jnp.zeros(50)], axis=1)
    centre, spread = of_warm_up(states[:, None])
    np.testing.assert_allclose(centre, [0, 1e6, 0], atol=1e-6)
    np.testing.assert_allclose(spread, [float(np.std(np.linspace(-1, 1, 50))), 1.0, 1.0], rtol=1e-5)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_units_do_not_depend_on_what_a_component_is_measured_in(factor):
    states = walk(1.0).next_observations
    scaled, other = (of_warm_up(x).scaled(x) for x in (states, factor * states))
    np.testing.assert_allclose(scaled, other, atol=1e-2)


def followed(state: AgentState, epochs: int, first: int = 0) -> AgentState:
    """After so many epochs without anything new."""
    grow = eqx.filter_jit(grown)
    for epoch in range(first, first + epochs):
        state = state._replace(epoch=jnp.array(epoch))
        state, _ = grow(CONFIG, state, key=jax.random.key(epoch))
    return state


@pytest.fixture(scope="module")
def settled() -> AgentState:
    return followed(begun(), 50)


def test_units_stay_where_they_belong(settled: AgentState):
    later = followed(settled, 150, first=50)
    np.testing.assert_allclose(later.scale.spread, settled.scale.spread, rtol=0.05)
    np.testing.assert_allclose(later.scale.centre, settled.scale.centre, atol=0.2)


def test_units_double_at_most_at_first_and_hardly_move_late():
    wide = algorithm.observe(CONFIG, begun(), walk(40.0))
    for epoch, most in ((0, 2.0), (9, 1.1), (99, 1.01)):
        after = followed(wide, 1, first=epoch)
        growth = np.asarray(after.scale.spread / wide.scale.spread)
        np.testing.assert_allclose(growth, most, rtol=1e-5)


@pytest.mark.parametrize("times", [10.0, 40.0])
def test_units_fit_a_body_that_moves_so_many_times_as_far_as_it_seemed_to(times):
    after = followed(algorithm.observe(CONFIG, begun(), walk(times)), 100)
    states = after.replay.transitions.next_observations[: int(after.replay.size)]
    assert 0.5 < float(jnp.std(states)) < 1.25  # goals, which units fit, are spread more evenly


def test_a_settled_unit_that_is_outgrown_by_less_than_half_hardly_moves(settled: AgentState):
    wider = walk(1.0)._replace(next_observations=walk(1.2).next_observations)
    more = algorithm.observe(CONFIG, settled, wider)
    after, metrics = grown(CONFIG, more, key=jax.random.key(0))
    assert 0.9 < float(metrics["units/largest"]) < 1.5
    np.testing.assert_allclose(after.scale.spread, more.scale.spread, rtol=2e-3)
    np.testing.assert_allclose(after.scale.centre, more.scale.centre, atol=2e-3)


def test_what_is_stored_is_the_same_in_the_bodys_units_after_they_grew():
    state = algorithm.observe(CONFIG, begun(), walk(4.0))
    goals = jax.random.normal(jax.random.key(2), state.episodes.goals.shape)
    state = state._replace(episodes=state.episodes._replace(goals=goals))
    after, metrics = grown(CONFIG, state, key=jax.random.key(3))
    assert float(metrics["units/growth"]) == pytest.approx(2)
    assert float(metrics["units/largest"]) > 2
    assert np.all(np.asarray(after.scale.spread) >= np.asarray(state.scale.spread))
    size = int(state.replay.size)
    for place in (
        lambda s: s.replay.transitions.observations[:size],
        lambda s: s.replay.transitions.next_observations[:size],
        lambda s: s.replay.transitions.goals[:size],
        lambda s: s.episodes.goals,
    ):
        was, now = in_body_units(state, place(state)), in_body_units(after, place(after))
        np.testing.assert_allclose(now, was, rtol=1e-4, atol=1e-4)
    # What a step changes a component by is measured anew, and is what it was, in the body's units.
    changes = [s.models.dynamics.change_scale * s.scale.spread for s in (state, after)]
    assert np.all(np.asarray(changes[1]) > np.asarray(changes[0]))
    # The average is in the same units, and is an average still.
    mean, model = (m.dynamics.change_scale for m in (after.kept, after.models))
    assert np.array_equal(mean, model)
    assert after.average is not None
    kept, was = (m.values[0].network.mlp.layers[0].weight for m in (after.average, state.kept))
    assert np.array_equal(kept, was)


def test_an_average_over_all_is_the_mean_and_a_shorter_one_forgets():
    def after(share, values):
        config = dataclasses.replace(CONFIG, averaged=share)
        average = jnp.zeros(())  # A tree of one weight.
        for update, value in enumerate(values):
            average = averaged(config, average, jnp.array(value, jnp.float32), jnp.array(update))
        return float(average)

    values = np.random.default_rng(0).normal(size=400)
    assert after(1.0, values) == pytest.approx(values[1:].mean(), abs=0.01)
    steps = np.repeat([0.0, 1.0], 200)
    assert after(1.0, steps) == pytest.approx(0.5, abs=0.01)
    assert after(0.1, steps) > 0.99
    assert after(0.1, np.zeros(5)) == 0


def test_the_agent_that_is_kept_is_the_average_if_there_is_one():
    state = begun()
    assert state.kept is state.average
    assert state._replace(average=None).kept is state.models
