"""To hold and to pass [D31]: what they count, where it can be counted by hand."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit

from everystate.learning.objectives import (
    FIRST_LOGIT,
    HOLD,
    PASS,
    Hit,
    PaperSum,
    objectives,
    pursued,
)
from everystate.presets import preset
from worlds import Known

DISCOUNT = 0.9
CONFIG = preset("test", "any-body.xml", discount=DISCOUNT)
AIM = objectives(CONFIG)[PASS]


def hit(near, now=0.0):
    """The hit before a way with this closeness at each step, after which nothing comes."""
    return float(AIM.counted(jnp.array([now, *near]), jnp.zeros(()))[0])


def test_the_objectives_are_the_configs():
    held, passed = objectives(CONFIG, jnp.array(-3.0))
    assert isinstance(held, PaperSum)
    assert isinstance(passed, Hit)
    (paper,) = objectives(preset("paper"), jnp.array(-3.0))
    assert isinstance(paper, PaperSum)
    assert float(paper.floor) == float(held.floor) == -3


def test_a_goal_that_is_passed_is_hit_as_one_that_is_held():
    assert hit([0.0, 0.0, 1.0, 0.0, 0.0]) == pytest.approx(DISCOUNT**3)
    assert hit([0.0, 0.0, 1.0, 1.0, 1.0]) == pytest.approx(DISCOUNT**3)


def test_being_half_way_there_for_ever_is_no_hit():
    """Many steps at half the closeness count as the best of them, not as their sum."""
    assert hit([0.5] * 50, now=0.5) == pytest.approx(0.5)
    assert hit([0.3, 0.9, 0.3]) == pytest.approx(DISCOUNT**2 * 0.9)


def test_where_a_goal_is_met_there_is_no_more_to_hit():
    """V(s, s) = 0 (eq. 2): no way is better than the one that is over, and none is worse."""
    for near in ([0.0, 0.0], [0.3, 0.9], [1.0, 1.0]):
        assert hit(near, now=1.0) == 1
    counted = jax.grad(lambda way: AIM.counted(way, jnp.zeros(()))[0])
    assert np.all(np.asarray(counted(jnp.array([0.95, 0.97, 0.97])))[1:] == 0)
    assert np.any(np.asarray(counted(jnp.array([0.5, 0.97, 0.97])))[1:] > 0)


def test_the_steps_are_those_to_the_hit():
    for steps in range(1, 8):
        found = AIM.steps(jnp.array([hit([0.0] * (steps - 1) + [1.0])]))
        assert float(found[0]) == pytest.approx(steps, abs=1e-4)
    assert np.isfinite(AIM.steps(jnp.zeros(1))).all()


def test_a_hit_is_climbed_in_steps_as_the_sum_is():
    worths = np.asarray(AIM.worth(jnp.array([0.0, 1.0])))
    np.testing.assert_allclose(worths, [-1 / (1 - DISCOUNT), 0], atol=1e-5)
    way, last = jnp.array([0.1, 0.2, 0.7]), jnp.array(0.4)
    assert float(AIM.climbed(way, last)) == float(AIM.worth(AIM.counted(way, last)[0]))
    assert float(AIM.ahead(way, last)) == float(AIM.climbed(way, last))


def test_each_state_of_a_way_is_worth_what_comes_from_there_on():
    """V learns along the whole way [D42]: of each state but the last, as if it had begun there."""
    way, last = jnp.array([0.1, 0.2, 0.9, 0.3, 0.4]), jnp.array(0.35)
    for aim, end in zip(objectives(CONFIG), (-3 * last, last), strict=True):
        along = aim.counted(way, end)
        assert along.shape == (4,)
        for step, found in enumerate(along):
            assert float(found) == float(aim.counted(way[step:], end)[0])


def test_only_the_sum_leads_on_where_a_goal_is_nearly_met():
    """A hit is flat at the goal; the sum has a slope until it is met exactly [D38]."""
    goal, off = jnp.zeros(4), jnp.full(4, 0.02)  # Two components, in states and in steps.
    slopes = [
        float(jnp.abs(jax.grad(lambda s, aim=aim: aim.closeness(s, goal))(off)).max())
        for aim in objectives(CONFIG)
    ]
    assert slopes[HOLD] > 2 * slopes[PASS] > 0
    assert all(float(aim.closeness(goal, goal)) == 1 for aim in objectives(CONFIG))


def test_outputs_become_shares_and_begin_near_zero():
    assert float(AIM.read(jnp.zeros(()))) < 0.05
    shares = np.asarray(AIM.read(jnp.linspace(-20, 20, 9)))
    assert np.all((shares >= 0) & (shares <= 1))
    assert np.all(np.diff(shares) > 0)


@pytest.mark.parametrize("target", [0.0, 0.2, 0.7, 1.0])
def test_the_error_is_least_and_zero_at_the_target(target):
    outputs = jnp.linspace(-12, 12, 2001)
    errors = np.asarray(AIM.errors(outputs, jnp.full(2001, target)))
    assert float(AIM.read(outputs)[errors.argmin()]) == pytest.approx(target, abs=1e-2)
    assert errors.min() == pytest.approx(0, abs=1e-3)
    assert np.all(errors > -1e-4)
    found = expit(np.asarray(outputs[1500]) - 4.0)
    entropy = sum(-p * np.log(p) for p in (target, 1 - target) if p)
    crossed = -target * np.log(found) - (1 - target) * np.log(1 - found)
    assert errors[1500] == pytest.approx(crossed - entropy, rel=1e-3, abs=1e-4)


@pytest.mark.parametrize(("lost", "off", "hit", "by"), [
    (0.0, 0.0, 0.6, HOLD), (0.04, 0.2, 0.6, HOLD), (0.04, 0.3, 0.6, PASS), (0.06, 0.0, 0.6, PASS),
    (1.0, 0.0, 0.6, PASS), (0.04, 0.3, 0.49, HOLD), (0.06, 0.3, 0.4, PASS),
])  # fmt: skip
def test_a_goal_is_held_if_little_is_lost_and_it_is_near_or_hit_as_soon(lost, off, hit, by):
    """What holds comes to a hit of 0.4 here."""

    def held(state, goal):
        at_goal = jnp.array_equal(state, goal)
        return jnp.where(at_goal, -lost / (1 - DISCOUNT), -1 / (1 - DISCOUNT))

    logit = jnp.log(hit / (1 - hit)) - FIRST_LOGIT
    goal, as_soon = jnp.ones(2), lambda state, goal: jnp.log(0.4 / 0.6) - FIRST_LOGIT
    values = held, lambda state, goal: logit, as_soon
    both, one = (SimpleNamespace(values=v, dynamics=Known()) for v in (values, values[:1]))
    assert int(pursued(CONFIG, both, goal - off, goal)) == by
    assert int(pursued(CONFIG, one, goal - off, goal)) == HOLD
