"""Hit and stay [D31]: what they count, where it can be counted by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit

from everystate.learning.objectives import HitAndStay, PaperSum, objective
from everystate.presets import preset

DISCOUNT = 0.9
AIM = objective(preset("test", "any-body.xml", discount=DISCOUNT))


def counted(near, now=0.0):
    """Hit and stay before a way with this closeness at each step, after which nothing comes."""
    return np.asarray(AIM.counted(jnp.array([now, *near]), jnp.zeros(2)))


def test_the_objective_is_the_configs():
    assert isinstance(AIM, HitAndStay)
    paper = objective(preset("paper"), jnp.array(-3.0))
    assert isinstance(paper, PaperSum)
    assert float(paper.floor) == -3


def test_a_goal_that_is_passed_is_hit_as_one_that_is_held_but_does_not_stay():
    passed, held = [0.0, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0, 1.0]
    hit, stay = counted(passed)
    assert hit == pytest.approx(DISCOUNT**3)
    assert stay == pytest.approx((1 - DISCOUNT) * DISCOUNT**2)
    assert counted(held)[0] == pytest.approx(hit)
    assert counted(held)[1] == pytest.approx((1 - DISCOUNT) * sum(DISCOUNT**t for t in (2, 3, 4)))


def test_being_half_way_there_for_ever_is_no_hit():
    """Many steps at half the closeness count as the best of them, not as their sum."""
    assert counted([0.5] * 50, now=0.5)[0] == pytest.approx(0.5)
    assert counted([0.3, 0.9, 0.3])[0] == pytest.approx(DISCOUNT**2 * 0.9)


def test_where_a_goal_is_met_there_is_no_more_to_hit_and_only_staying_is_asked_for():
    """V(s, s) = 0 (eq. 2): no way is better than the one that is over, and none is worse."""
    for near in ([0.0, 0.0], [0.3, 0.9], [1.0, 1.0]):
        hit, stay = counted(near, now=1.0)
        assert hit == 1
        assert stay == pytest.approx(counted(near)[1])
    worth = jax.grad(lambda way: AIM.counted(way, jnp.zeros(2))[0])
    assert np.all(np.asarray(worth(jnp.array([0.95, 0.97, 0.97])))[1:] == 0)
    assert np.any(np.asarray(worth(jnp.array([0.5, 0.97, 0.97])))[1:] > 0)


def test_staying_for_good_is_worth_one():
    assert counted([1.0] * 200, now=1.0) == pytest.approx([1, 1], abs=1e-4)


def test_the_steps_are_those_to_the_hit():
    for steps in range(1, 8):
        heads = counted([0.0] * (steps - 1) + [1.0])
        assert float(AIM.steps(jnp.asarray(heads)[None])[0]) == pytest.approx(steps, abs=1e-4)
    assert np.isfinite(AIM.steps(jnp.zeros((1, 2)))).all()


def test_both_are_climbed_alike_in_steps():
    far, met, held = (jnp.array(x) for x in ([0.0, 0.0], [1.0, 0.0], [1.0, 1.0]))
    horizon = 1 / (1 - DISCOUNT)
    worths = [float(AIM.worth(x)) for x in (far, met, held)]
    assert worths == pytest.approx([-2 * horizon, -horizon, 0])
    way = jnp.array([0.1, 0.2, 0.7])
    assert float(AIM.climbed(way, met)) == float(AIM.worth(AIM.counted(way, met)))
    assert float(AIM.ahead(way, met)) == float(AIM.climbed(way, met))


def test_outputs_become_shares_and_begin_near_zero():
    assert np.all(np.asarray(AIM.read(jnp.zeros(2))) < 0.05)
    outputs = jnp.linspace(-20, 20, 9).reshape(-1, 1).repeat(2, axis=1)
    heads = np.asarray(jax.vmap(AIM.read)(outputs))
    assert np.all((heads >= 0) & (heads <= 1))
    assert np.all(np.diff(heads, axis=0) > 0)


@pytest.mark.parametrize("target", [0.0, 0.2, 0.7, 1.0])
def test_the_error_is_least_and_zero_at_the_target(target):
    outputs = jnp.linspace(-12, 12, 2001)[:, None].repeat(2, axis=1)
    errors = np.asarray(AIM.errors(outputs, jnp.full((2001, 2), target)))
    best = np.asarray(jax.vmap(AIM.read)(outputs))[errors.argmin(), 0]
    assert best == pytest.approx(target, abs=1e-2)
    assert errors.min() == pytest.approx(0, abs=1e-3)
    assert np.all(errors > -1e-4)
    # Two heads, each with the cross-entropy of its own.
    found = expit(np.asarray(outputs[1500, 0]) - 4.0)
    entropy = sum(-p * np.log(p) for p in (target, 1 - target) if p)
    crossed = -target * np.log(found) - (1 - target) * np.log(1 - found)
    assert errors[1500] == pytest.approx(2 * (crossed - entropy), rel=1e-3, abs=1e-4)
