"""When episodes end: against Algorithm 1's inner loop, written out."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from everystate.learning import episodes as ep
from everystate.presets import preset

BODIES, STEPS = 10, 120


def random_values(seed):
    """V(s_t, g_e) [t, e, body]: for each goal a walk with ties, rises and falls, below 0."""
    random = np.random.default_rng(seed)
    moves = random.choice(
        [-1.0, 0.0, 1.0, 2.0], (STEPS, STEPS + 1, BODIES), p=[0.15, 0.25, 0.5, 0.1]
    )
    return -1000 + np.cumsum(moves, axis=0)


def ends(config, values):
    """The times at which each body's episodes end, by the package."""
    advance, episodes = jax.jit(ep.advance, static_argnums=0), ep.no_episodes(config, 2)
    bodies, goal = np.arange(BODIES), np.zeros(BODIES, int)
    states, ended = jnp.zeros((BODIES, 2)), []
    for t in range(STEPS):
        v = jnp.asarray(values[t, goal, bodies], jnp.float32)
        episodes, over = advance(config, episodes, states, v)
        goal = goal + np.asarray(over)
        v = jnp.asarray(values[t, goal, bodies], jnp.float32)
        episodes = ep.restart(episodes, over, jnp.zeros((BODIES, 2)), jnp.zeros(BODIES, int), v)
        ended.append(np.asarray(over))
    return [list(np.flatnonzero(body)) for body in np.stack(ended, axis=1)]


def literal(v, patience=1, cap=10**9):
    """The same for one body with values [t, e]: the paper's `while v_cur >= v_prev`.

    With patience, the episode ends at that many steps in a row below its best value so far.
    """
    t, episode, ended = 0, 0, []
    while True:
        ended.append(t)
        episode += 1
        v_cur = v_prev = v[t, episode]
        falls = length = 0
        while (v_cur >= v_prev if patience == 1 else falls < patience) and length < cap:
            v_prev = v_cur if patience == 1 else max(v_cur, v_prev)
            t, length = t + 1, length + 1
            if t == STEPS:
                return ended
            v_cur = v[t, episode]
            falls = 0 if v_cur >= v_prev else falls + 1


@pytest.mark.parametrize(("patience", "cap"), [(1, 10**6), (1, 3), (4, 10**6), (4, 7), (9, 1)])
def test_episodes_end_as_in_algorithm_1(patience, cap):
    config = preset("test", patience=patience, max_episode_steps=cap)
    values = random_values(patience + cap)
    expected = [literal(values[:, :, b], patience, cap) for b in range(BODIES)]
    assert ends(config, values) == expected
    assert max(np.diff(expected[0])) > min(cap, 2) - 1  # Not all episodes are of one step.


@pytest.mark.parametrize("value", [-1.0, 0.0, 0.5])  # Unbounded, V may be above 0.
def test_every_body_takes_a_goal_at_its_first_step(value):
    config = preset("test")
    _, over = ep.advance(
        config, ep.no_episodes(config, 2), jnp.zeros((BODIES, 2)), jnp.full(BODIES, value)
    )
    assert np.all(over)


def under_way():
    """Ten bodies two steps into an episode, with goals along a line."""
    episodes = ep.no_episodes(preset("test"), 2)
    goals = jnp.stack([jnp.arange(10.0), jnp.zeros(10)], axis=1)
    return episodes._replace(
        goals=goals,
        best_values=jnp.full(BODIES, -5.0),
        steps_since_best=jnp.full(BODIES, 1, jnp.int32),
        lengths=jnp.full(BODIES, 2, jnp.int32),
    )


def test_only_bodies_whose_episode_is_over_restart():
    episodes, over = under_way(), jnp.arange(10) % 3 == 0
    given = jnp.full((10, 2), 7.0), jnp.ones(10, int), jnp.full(10, -2.0)
    after = ep.restart(episodes, over, *given)
    over = np.asarray(over)
    for name in ("goals", "objectives", "best_values", "steps_since_best", "lengths", "nearest"):
        old, new = np.asarray(getattr(episodes, name)), np.asarray(getattr(after, name))
        np.testing.assert_array_equal(new[~over], old[~over], err_msg=name)
    np.testing.assert_array_equal(after.goals[over], np.full((4, 2), 7.0))
    np.testing.assert_array_equal(after.objectives[over], np.ones(4))
    np.testing.assert_array_equal(after.best_values[over], np.full(4, -2.0))
    np.testing.assert_array_equal(after.steps_since_best[over], np.zeros(4))
    np.testing.assert_array_equal(after.lengths[over], np.ones(4))
    assert np.isinf(after.nearest[over]).all()
    np.testing.assert_array_equal(after.tally, episodes.tally)


def test_the_tally_counts_ended_episodes_and_those_that_came_near():
    config = preset("test", patience=2)
    episodes = under_way()._replace(nearest=jnp.where(jnp.arange(10) == 0, 0.1, jnp.inf))
    # Body 1 stands within reach of its goal by both components, body 2 by one only.
    states = jnp.full((10, 2), 50.0).at[1].set(jnp.array([1.2, -0.24]))
    states = states.at[2].set(jnp.array([2.0, 0.3]))
    values = jnp.where(jnp.arange(10) < 6, -6.0, -4.0)  # The first six have had no rise for two.
    after, over = ep.advance(config, episodes, states, values)
    assert np.asarray(over).tolist() == [True] * 6 + [False] * 4
    np.testing.assert_array_equal(after.tally, [6, 2, 12])
    metrics = ep.episode_metrics(after)
    assert float(metrics["episode/ended"]) == 6
    assert float(metrics["episode/reached"]) == pytest.approx(1 / 3)
    assert float(metrics["episode/length"]) == 2
    # Taking a first goal ends nothing.
    first, over = ep.advance(config, ep.no_episodes(config, 2), states, values)
    assert np.all(over)
    np.testing.assert_array_equal(first.tally, np.zeros(3))
    assert float(ep.episode_metrics(first)["episode/length"]) == 0


def test_bodies_wander_for_as_long_as_they_are_meant_to_and_enter_no_tally():
    config = preset("test", wander_steps=3, patience=2, max_episode_steps=200)
    length, by = ep.WANDERED * config.wander_steps, jnp.array([ep.WANDER, 0] * (BODIES // 2))
    states, worse = jnp.zeros((BODIES, 2)), jnp.full(BODIES, -1.0)
    given = states, by, jnp.zeros(BODIES)
    episodes = ep.restart(ep.no_episodes(config, 2), jnp.full(BODIES, True), *given)
    ended = []
    for _ in range(length):
        episodes, over = ep.advance(config, episodes, states, worse)
        ended.append(np.asarray(over))
    wandering = np.stack(ended)[:, ::2]
    assert not wandering[:-1].any()
    assert wandering[-1].all()
    assert np.stack(ended)[:, 1::2].any(axis=0).all()
    ends = np.stack(ended)[:, 1::2].sum()
    assert float(episodes.tally[0]) == ends
