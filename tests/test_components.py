"""How much each component counts, told from what was visited [D39]."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
from flowjax.distributions import Normal

from everystate.learning.components import asked, counted, factors
from everystate.learning.objectives import objectives
from everystate.learning.replay import Transitions
from everystate.learning.rewards import placing
from everystate.presets import preset
from worlds import Known

ROWS = 4096


def visited(columns, moved) -> Transitions:
    """Transitions of which each component is as it is, and then as it moved."""
    before, after = (jnp.stack(x, axis=1).astype(jnp.float32) for x in (columns, moved))
    return Transitions(before, (after - before)[:, :1], after, before)


def weights_of(columns, moved) -> np.ndarray:
    """By dynamics that know where an action moves the first, and expect nothing else to change."""
    known = Known(lambda s, a: Normal(s.at[0].add(a[0])), len(columns))
    return np.asarray(counted(known, visited(columns, moved)))


def test_what_no_action_changes_counts_for_nothing() -> None:
    rng = np.random.default_rng(0)
    place, copy, before, after, step = rng.normal(size=(5, ROWS))
    target = np.round(copy)  # one of a few, for good
    spiked = [np.where(rng.random(ROWS) < 0.1, x**2, 0.0) for x in (before, after)]
    columns = [place, target, before, spiked[0]]
    moved = [place + step, target, after, spiked[1]]
    np.testing.assert_array_equal(weights_of(columns, moved), [1, 0, 0, 0])


def test_what_only_the_dynamics_can_tell_counts_fully() -> None:
    """A velocity under random pushes is not what it was a step ago."""
    place, push = np.random.default_rng(0).normal(size=(2, ROWS))
    assert weights_of([0.1 * place], [push]) == 1


def test_a_single_component_counts() -> None:
    place, step = np.random.default_rng(0).normal(size=(2, ROWS))
    columns = [2 * place], [2 * place + 0.1 * step]
    known = Known(lambda s, a: Normal(s + a), 1)
    np.testing.assert_array_equal(jax.jit(counted)(known, visited(*columns)), 1)


def test_what_stands_twice_counts_once() -> None:
    place, other, step = np.random.default_rng(0).normal(size=(3, ROWS))
    found = weights_of(
        [place, other, -3 * place + 1], [place, other + 0.1 * step, -3 * place + 1.0001]
    )
    np.testing.assert_allclose(found, [0, 1, 1], atol=0.01)  # the first never changes
    columns = [place, other, -3 * place, place]
    moved = [place + 0.1 * step, other + 0.1 * step, -3 * (place + 0.1 * step), place + 0.1 * step]
    np.testing.assert_allclose(weights_of(columns, moved), [1 / 3, 1, 1 / 3, 1 / 3], atol=0.02)


def test_distances_count_by_weight() -> None:
    """A constant component leaves the reward what it is without."""
    config = preset("quick")
    state, goal = jnp.array([0.3, 5.0]), jnp.array([0.1, -7.0])

    def near(weights, s, g):
        dynamics = SimpleNamespace(
            weights=jnp.array(weights), change_scale=jnp.array([0.1, 1e-3])[: len(weights)]
        )
        place = placing(config, SimpleNamespace(dynamics=dynamics))
        return [float(aim.closeness(place(s), place(g))) for aim in objectives(config)]

    alone = near([1.0], state[:1], goal[:1])
    np.testing.assert_allclose(near([1.0, 0.0], state, goal), alone, rtol=1e-5)
    assert near([0.5, 0.0], state, goal) == near([1.0, 0.0], state, goal)
    np.testing.assert_allclose(jnp.mean(factors(jnp.array([0.2, 0.0, 1.0])) ** 2), 1, rtol=1e-6)


def test_no_goal_asks_for_it() -> None:
    states, goals = jax.random.normal(jax.random.key(0), (2, 5, 3))
    found = asked(jnp.array([1.0, 0.0, 0.2]), states, goals)
    expected = np.stack([goals[:, 0], states[:, 1], goals[:, 2]], axis=1)
    np.testing.assert_array_equal(found, expected)
