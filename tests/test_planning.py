"""The search at act time (4.2): known dynamics and values, and what it should find with them."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flowjax.distributions import Normal

from everystate.errors import EverystateError
from everystate.learning.models import Models
from everystate.learning.planning import Planning, plan
from small import of_paper
from worlds import Known

CONFIG = of_paper(reward_space="state", k=10.0, absorb=1.0, discount=0.98)


class Still:
    """A policy whose centre is always the same."""

    def __init__(self, action: float = 0.0) -> None:
        self.action = action

    def central(self, *_: Any) -> Any:
        return jnp.full(1, self.action)


def known(outcomes: Any, value: Any, policy: Any = None) -> Any:
    """Models whose policy knows nothing."""
    parts: dict[str, Any] = {
        "state_flow": Normal(jnp.zeros(2)),
        "dynamics": Known(outcomes),
        "policies": (policy or Still(),),
        "curriculum": None,
        "values": (value,),
    }
    return Models(**parts)


def pushed(state: Any, action: Any) -> Normal:
    """A place and its velocity, which the action changes."""
    place, velocity = state
    velocity = velocity + 0.25 * action[0]
    return Normal(jnp.stack([place + velocity, velocity]), jnp.full(2, 1e-4))


def nothing(state: Any, goal: Any) -> Any:
    return jnp.zeros(())


def planned(models: Any, state: Any, goal: Any, key: int = 0, **fields: Any) -> Any:
    arrays = jnp.asarray(state, jnp.float32), jnp.asarray(goal, jnp.float32)
    planning = Planning(**fields)
    return plan(CONFIG, planning, models, *arrays, key=jax.random.key(key))


def chosen(*args: Any, **fields: Any) -> Any:
    return np.asarray(planned(*args, **fields).actions[0])


def test_it_stays_at_a_goal_that_v_thinks_nothing_of_leaving() -> None:
    """With `absorb` 1 nothing counts after the goal is reached; in the search's own sum it does."""
    models = known(pushed, nothing)
    for key in range(3):
        assert abs(chosen(models, [0.0, 0.0], [0.0, 0.0], key)[0]) < 0.35
        assert chosen(models, [0.0, 0.4], [0.0, 0.0], key)[0] < -0.5  # brakes
        assert chosen(models, [0.0, -0.4], [0.0, 0.0], key)[0] > 0.5


def test_its_noises_are_those_of_the_key() -> None:
    """Corrections are found on imagined outcomes, which differ from key to key."""

    def wild(state: Any, action: Any) -> Normal:
        return Normal(state + 0.2 * action[0], jnp.full(2, 0.1))

    models = known(wild, lambda state, goal: -((state[0] - goal[0]) ** 2))
    found = [float(chosen(models, [0.0, 0.0], [1.0, 0.0], key)[0]) for key in (0, 0, 1)]
    assert found[0] == found[1]
    assert found[0] != found[2]


def test_beyond_its_horizon_it_goes_by_v() -> None:
    models = known(pushed, lambda state, goal: -10 * jnp.abs(state[0] - goal[0]))
    assert chosen(models, [0.0, 0.0], [9.0, 0.0], horizon=2)[0] > 0.8
    assert chosen(models, [0.0, 0.0], [-9.0, 0.0], horizon=2)[0] < -0.8


@pytest.mark.parametrize("action", [-0.5, 0.25])
def test_where_nothing_is_gained_the_policy_acts(action: float) -> None:
    """V is level and the goal far: the search has nothing to say, and changes nothing."""
    found = planned(known(pushed, nothing, Still(action)), [0.0, 0.0], [90.0, 0.0])
    assert not found.corrected
    np.testing.assert_array_equal(found.actions, np.full((8, 1), action, np.float32))


def test_what_may_be_luck_is_not_taken() -> None:
    """The outcomes of an action are so uncertain that eight do not tell whether it gains."""

    def wild(state: Any, action: Any) -> Normal:
        return Normal(state + 0.01 * action[0], jnp.full(2, 3.0))

    models = known(wild, lambda state, goal: state[0] * (1 + 100 * jnp.abs(jnp.sin(99 * state[0]))))
    taken = [planned(models, [0.0, 0.0], [9.0, 9.0], key).corrected for key in range(10)]
    assert np.mean(taken) <= 0.2


def test_the_worst_outcome_counts() -> None:
    """Up is better on average, and at times much worse."""

    def noisy(state: Any, action: Any) -> Normal:
        spread = jnp.maximum(action[0], 0) * 3 + 1e-4
        return Normal(state + 0.1 * action[0], jnp.full(2, spread))

    models = known(noisy, lambda state, goal: state[0])
    for key in range(4):
        assert chosen(models, [0.0, 0.0], [9.0, 9.0], key, horizon=1, rollouts=8)[0] <= 0


def test_corrections_go_beyond_no_bound() -> None:
    models = known(pushed, lambda state, goal: 10 * state[0], Still(0.9))
    found = planned(models, [-6.0, 0.0], [9.0, 0.0], rounds=20)
    assert found.corrected
    assert (np.abs(found.actions) <= 1).all()
    assert found.gain > 0


@pytest.mark.parametrize(
    ("field", "value"),
    [("horizon", 0), ("step", 0.0), ("rounds", 0), ("rollouts", 10**5), ("checks", 1)],
)
def test_a_bad_number_is_named(field: str, value: Any) -> None:
    with pytest.raises(EverystateError, match=f"planning {field} is {value}"):
        Planning(**{field: value})
