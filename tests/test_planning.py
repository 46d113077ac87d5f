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
from everystate.presets import preset
from worlds import Known

CONFIG = preset("test", reward_space="state", k=10.0, absorb=1.0, discount=0.98)


def known(outcomes: Any, value: Any, actions: int = 1) -> Any:
    """Models whose policy knows nothing."""
    wide = Normal(jnp.zeros(actions), jnp.full(actions, 1.0))
    parts: dict[str, Any] = {
        "state_flow": Normal(jnp.zeros(2)),
        "dynamics": Known(outcomes),
        "policies": (lambda *_: wide,),
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


def chosen(models: Any, state: Any, goal: Any, key: int = 0, **fields: Any) -> Any:
    planning = Planning(**{"candidates": 64, "rounds": 4, **fields})
    arrays = jnp.asarray(state, jnp.float32), jnp.asarray(goal, jnp.float32)
    return np.asarray(plan(CONFIG, planning, models, *arrays, key=jax.random.key(key))[0])


def test_it_stays_at_a_goal_that_v_thinks_nothing_of_leaving() -> None:
    """With `absorb` 1 nothing counts after the goal is reached; in the search's own sum it does."""
    models = known(pushed, nothing)
    for key in range(3):
        assert abs(chosen(models, [0.0, 0.0], [0.0, 0.0], key)[0]) < 0.35
        assert chosen(models, [0.0, 0.4], [0.0, 0.0], key)[0] < -0.5  # brakes
        assert chosen(models, [0.0, -0.4], [0.0, 0.0], key)[0] > 0.5


def test_beyond_its_horizon_it_goes_by_v() -> None:
    models = known(pushed, lambda state, goal: -10 * jnp.abs(state[0] - goal[0]))
    assert chosen(models, [0.0, 0.0], [9.0, 0.0], horizon=2)[0] > 0.8
    assert chosen(models, [0.0, 0.0], [-9.0, 0.0], horizon=2)[0] < -0.8


def test_the_worst_outcome_counts_unless_it_is_told_otherwise() -> None:
    """Up is better on average, down is safe."""

    def noisy(state: Any, action: Any) -> Normal:
        up = action[0] > 0
        return Normal(state + jnp.where(up, 0.1, 0.0), jnp.full(2, jnp.where(up, 3.0, 1e-4)))

    models = known(noisy, lambda state, goal: state[0])
    options = {"horizon": 1, "rollouts": 8}
    assert all(chosen(models, [0.0, 0.0], [9.0, 9.0], key, **options)[0] <= 0 for key in range(4))


@pytest.mark.parametrize(
    ("field", "value"), [("horizon", 0), ("candidates", 1), ("rounds", 0), ("rollouts", 10**5)]
)
def test_a_bad_number_is_named(field: str, value: Any) -> None:
    with pytest.raises(EverystateError, match=f"planning {field} is {value}"):
        Planning(**{field: value})
    with pytest.raises(EverystateError, match="planning elites is 32: choose 1 to 31"):
        Planning(elites=32)
