"""The three weighted buffers of Appendix A: what is drawn, how weights age, where goals lie."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from everystate.learning import replay as rb
from everystate.learning.replay import Transitions
from everystate.learning.weights import AS_THEY_ARE, draw
from small import of_paper

BODIES = 10
ONE = jnp.ones(2)
"""What a step changes each component by."""
CONFIG = of_paper(num_bodies=BODIES, capacity=400, batch_size=1000)


def walked(first, steps):
    """Transitions [steps * bodies, ...]: the state of a body is (its number, the time)."""
    time, body = np.divmod(np.arange(first * BODIES, (first + steps) * BODIES), BODIES)
    before = jnp.stack([jnp.asarray(body, jnp.float32), jnp.asarray(time, jnp.float32)], axis=1)
    step = jnp.zeros_like(before).at[:, 1].set(1.0)
    return Transitions(before, before[:, 1:], before + step, before[:, :0])


add = eqx.filter_jit(rb.add)  # which is called again and again
decay_states = eqx.filter_jit(rb.decay_states)


def ring(steps, chunk=5):
    """A ring of 40 steps of 10 bodies after so many steps, all weights 1."""
    replay = rb.empty(CONFIG, 2, 1)
    for first in range(0, steps, chunk):
        new = walked(first, chunk)
        replay = add(CONFIG, replay, new, jnp.zeros(chunk * BODIES), jnp.zeros(chunk * BODIES))
    return replay


def test_the_ring_keeps_the_newest():
    replay = ring(25)
    assert int(replay.size) == 250
    assert int(replay.position) == 250
    assert np.isneginf(replay.goals.log[250:]).all()
    replay = ring(55)
    assert int(replay.size) == replay.capacity == 400
    assert int(replay.position) == 150
    times = np.asarray(replay.transitions.observations[:, 1])
    assert sorted(set(times)) == list(range(15, 55))
    assert np.all(times[:150] >= 40)  # The first slots hold the newest.
    reached = replay.transitions.next_observations - replay.transitions.observations
    np.testing.assert_array_equal(reached, np.tile([0, 1], (400, 1)))


def test_weights_enter_their_own_buffers():
    new, weights = walked(0, 1), jnp.arange(10.0)
    replay = rb.add(CONFIG, rb.empty(CONFIG, 2, 1), new, weights, 2 * weights)
    np.testing.assert_array_equal(replay.states.log[:10], np.zeros(10))
    np.testing.assert_array_equal(replay.goals.log[:10], weights)
    np.testing.assert_array_equal(replay.of_transitions.log[:10], 2 * weights)


@pytest.mark.parametrize("half_life", [1, 20, 50])
def test_a_states_weight_halves_in_a_half_life(half_life):
    replay = old = ring(5)
    for _ in range(half_life):
        replay = decay_states(replay, float(half_life))
    halved = np.asarray(replay.states.log[:50])
    np.testing.assert_allclose(halved, np.full(50, -np.log(2)), rtol=2e-6)
    assert np.isneginf(replay.states.log[50:]).all()
    assert np.array_equal(replay.goals.log, old.goals.log)
    # What comes later has weight 1, so that an hour-old state is half as likely to be drawn.
    replay = rb.add(CONFIG, replay, walked(5, 5), jnp.zeros(50), jnp.zeros(50))
    slots = draw(replay.states, AS_THEY_ARE, 30_000, key=jax.random.key(1))
    old_draws = int((slots < 50).sum())
    assert stats.binomtest(old_draws, 30_000, 1 / 3).pvalue > 1e-3


@pytest.mark.parametrize("steps", [5, 25, 40, 55, 95])
def test_states_that_led_to_their_goals_are_the_same_body_some_steps_earlier(steps):
    config = dataclasses.replace(CONFIG, approach_share=1.0, approach_steps=7)
    replay = ring(steps)
    minibatch = rb.sample(config, replay, ONE, key=jax.random.key(2))
    states, goals = np.asarray(minibatch.states), np.asarray(minibatch.goals)
    ago = goals[:, 1] - states[:, 1]
    np.testing.assert_array_equal(goals[:, 0], states[:, 0])
    assert set(ago) == set(range(min(7, steps - 1) + 1))
    assert (ago == 0).mean() > (ago == min(7, steps - 1)).mean()
    assert states[:, 1].min() >= max(1, steps - 39)  # Nothing earlier is in the ring.


def test_approaches_are_the_stated_share_of_the_pairs():
    config = dataclasses.replace(CONFIG, approach_share=0.5, approach_steps=1, batch_size=4000)
    minibatch = rb.sample(config, ring(95), ONE, key=jax.random.key(6))
    same = (minibatch.states[:, 0] == minibatch.goals[:, 0]) & (
        jnp.abs(minibatch.states[:, 1] - minibatch.goals[:, 1]) < 2
    )
    assert float(same.mean()) == pytest.approx(0.5, abs=0.05)


def test_a_minibatch_holds_what_its_slots_hold():
    replay = ring(25)
    minibatch = rb.sample(CONFIG, replay, ONE, key=jax.random.key(4))
    reached = replay.transitions.next_observations
    np.testing.assert_array_equal(minibatch.goals, reached[minibatch.goal_slots])
    np.testing.assert_array_equal(
        minibatch.transitions.observations,
        replay.transitions.observations[minibatch.transition_slots],
    )
    for slots in (minibatch.goal_slots, minibatch.transition_slots):
        assert int(slots.max()) < 250
    assert float(minibatch.states[:, 1].min()) >= 1  # An empty slot would show as time 0.
    assert not np.array_equal(minibatch.goal_slots, minibatch.transition_slots)


def test_refresh_writes_only_what_was_drawn():
    replay = ring(55)
    minibatch = rb.sample(CONFIG, replay, ONE, key=jax.random.key(5))
    few = minibatch._replace(
        goal_slots=minibatch.goal_slots[:30], transition_slots=minibatch.transition_slots[:30]
    )
    after = rb.refresh(
        CONFIG,
        replay,
        few,
        few.goal_slots.astype(jnp.float32),
        -few.transition_slots.astype(jnp.float32),
    )
    slots = np.arange(400)
    goals, transitions = np.isin(slots, few.goal_slots), np.isin(slots, few.transition_slots)
    np.testing.assert_array_equal(after.goals.log[:400], np.where(goals, slots, 0))
    np.testing.assert_array_equal(after.of_transitions.log[:400], np.where(transitions, -slots, 0))
    np.testing.assert_array_equal(after.states.log, replay.states.log)


def test_visited_goals_are_drawn_by_their_weight_as_goals():
    """Of two kinds of state, one a hundred times rarer, both come about equally often."""
    config = of_paper(weight_temper=1.0, weight_clip=20.0, capacity=500)
    states = jnp.where(jnp.arange(400) < 4, 1.0, 0.0)[:, None]
    transitions = rb.Transitions(states, jnp.zeros((400, 1)), states, states[:, :0])
    rarity = jnp.where(states[:, 0] == 1.0, jnp.log(99.0), 0.0)
    replay = rb.add(config, rb.empty(config, 1, 1), transitions, rarity, rarity)
    goals = rb.visited_goals(config, replay, 4000, key=jax.random.key(0))
    assert goals.shape == (4000, 1)
    assert float(goals.mean()) == pytest.approx(0.5, abs=0.05)


def test_approaches_do_not_cross_a_break():
    """A body that came to an end and started elsewhere reached nothing after it from before it."""
    config = of_paper(num_bodies=1, capacity=40, batch_size=32)
    config = dataclasses.replace(config, approach_share=1.0, approach_steps=10)
    before = jnp.arange(20.0)[:, None]
    after = before + 1
    before = before.at[10:].add(100.0)  # from step 10 on elsewhere
    after = after.at[10:].add(100.0)
    replay = rb.empty(config, 1, 1)
    replay = rb.add(
        config,
        replay,
        rb.Transitions(before, jnp.zeros((20, 1)), after, after[:, :0]),
        jnp.zeros(20),
        jnp.zeros(20),
    )
    minibatch = rb.sample(config, replay, ONE, key=jax.random.key(1))
    led, goal = minibatch.states, minibatch.goals
    np.testing.assert_array_equal(np.asarray(led > 50), np.asarray(goal > 50))
    assert float((goal - led).max()) > 5


def test_calm_goals_are_those_that_hardly_changed_in_a_step():
    """Every tenth item moved by a hundredth of what the others did, in units of the change."""
    items, unit = 400, jnp.array([1.0, 100.0])
    calm = jnp.arange(items) % 10 == 0
    step = jnp.where(calm, 0.01, 1.0)[:, None] * unit[None]
    before = jax.random.normal(jax.random.key(0), (items, 2))
    moved = Transitions(before, before[:, 1:], before + step, before[:, :0])
    empty, even = rb.empty(CONFIG, 2, 1), jnp.zeros(items)
    replay = rb.add(CONFIG, empty, moved, even, even)

    def share(**fields):
        config = dataclasses.replace(CONFIG, **fields)
        slots = rb.goal_slots(config, replay, unit, 5000, key=jax.random.key(1))
        return float(calm[slots].mean())

    assert share() == pytest.approx(0.1, abs=0.02)
    # Of sixteen at least one is calm with probability 1 - 0.9^16.
    best = 1 - 0.9**16
    assert share(calm_share=1.0) == pytest.approx(best, abs=0.02)
    assert share(calm_share=0.5) == pytest.approx((0.1 + best) / 2, abs=0.02)
