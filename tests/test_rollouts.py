"""Candidates judged by whole ways [D40], in worlds so simple that the best is known."""

from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flowjax.distributions import Normal

from everystate.learning.losses import better_loss
from everystate.learning.objectives import HOLD, PASS, objectives
from everystate.learning.policy import Improvement, Policy
from everystate.learning.rollouts import improve_by_rollouts
from everystate.presets import preset
from worlds import Known

CONFIG = preset("quick", imagined_steps=8, kept_steps=4, j=16, N=4)
STEP, CERTAIN = 0.5, 1e-6
STATE, GOAL = jnp.array([[0.0]]), jnp.array([[4 * STEP]])


class Stays(Policy):
    """A policy whose centre does nothing, and whose samples are anything."""

    centre: Any

    def __init__(self, centre: Any = 0.0) -> None:
        self.flow: Any = None
        self.both, self.horizontal = False, ()
        self.centre = jnp.asarray(centre)

    def central(self, state: Any, goal: Any) -> Any:
        return jnp.zeros(1) + self.centre

    def at(self, state: Any, goal: Any, latent: Any) -> Any:
        return latent


def moved(state: Any, action: Any) -> Normal:
    """The action says how far; beyond the goal is a wall."""
    return Normal(jnp.minimum(state + STEP * action, GOAL[0]), CERTAIN)


def gambled(state: Any, action: Any) -> Normal:
    """As before, but whoever moves may land far off."""
    return Normal(moved(state, action).loc, CERTAIN + jnp.abs(action))


def nowhere(state: Any, goal: Any) -> Any:
    """V of one that thinks the goal far from everywhere but there."""
    return jnp.where(jnp.abs(state - goal)[0] < 0.1, 0.0, -50.0)


def improved(world: Any, number: int = HOLD, state: Any = STATE, **fields: Any) -> Any:
    config = CONFIG if not fields else preset("quick", **{**ASKED, **fields})
    models = SimpleNamespace(state_flow=Normal(jnp.zeros(1)), dynamics=Known(world, 1))
    aim = objectives(config)[number]
    found = improve_by_rollouts(
        config, models, Stays(), nowhere, aim, state, GOAL, key=jax.random.key(0)
    )
    return jax.tree.map(lambda x: x[0], found)


ASKED = {"imagined_steps": 8, "kept_steps": 4, "j": 16, "N": 4}


@pytest.mark.parametrize("number", [HOLD, PASS])
def test_an_action_that_must_be_kept_to_pay_is_found(number) -> None:
    """One step towards the goal gains nothing by V; four in a row arrive."""
    found = improved(moved, number)
    assert found.action[0] > 0.8
    assert found.gain > 1
    alone = improved(moved, number, kept_steps=1)
    assert alone.gain < found.gain / 2


def test_what_does_well_already_gains_nothing() -> None:
    found = improved(moved, state=GOAL)
    assert float(found.gain) == pytest.approx(0, abs=1e-4)


def test_the_worst_way_counts() -> None:
    """Where every move is a gamble, it pays on average to move, and at worst to stay."""
    near = GOAL - 0.4
    on_average = improved(gambled, state=near, pessimism="mean", N=64)
    at_worst = improved(gambled, state=near, N=64)
    assert at_worst.gain < on_average.gain
    assert jnp.abs(at_worst.action[0]) <= jnp.abs(on_average.action[0])


def test_the_centre_is_led_as_steeply_as_is_gained_on_the_way() -> None:
    """A gain of 2 steps half a unit of action away is a slope of 4."""
    states, goals = jnp.zeros((2, 1)), jnp.ones((2, 1))
    zeros, gains = jnp.zeros(2), jnp.array([2.0, 0.0])
    found = Improvement(jnp.array([[0.5], [1.0]]), zeros, zeros, zeros, zeros, gains)

    def loss(centre):
        return better_loss(Stays(centre), states, goals, found)

    assert float(jax.grad(loss)(jnp.zeros(1))[0]) == pytest.approx(-4)


def test_the_same_key_finds_the_same() -> None:
    one, other = improved(moved), improved(moved)
    np.testing.assert_array_equal(one.action, other.action)
