"""Goals that ask for a part of a state, and the whole ones that an agent makes of them."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import everystate
from everystate import preset
from everystate.errors import EverystateError
from everystate.features import parts
from everystate.learning.completion import Atlas, completed
from everystate.learning.models import Models, Scale
from everystate.skills.ant import STANDS, state

HANGING = np.array([0.3, -1, 0, 0, 0], np.float32)


@pytest.fixture(scope="module")
def cartpole() -> everystate.Agent:
    return everystate.load("cartpole")


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ({"pole_angel": 0}, "'pole_angel': did you mean 'pole_angle'"),
        ({}, "asks for nothing"),
        ({"cos_pole": 0.2, "sin_pole": 0.1}, "cos_pole = 0.2, sin_pole = 0.1 is of no angle"),
        ({"cos_pole": 1.5}, "cos_pole = 1.5 is of no angle"),
        ({"cart": np.nan}, "cart is nan: give a finite number"),
        ({"cart": "left"}, "cart is 'left': give a number"),
        ({"pole_angle": 0, "cos_pole": 1}, "pole_angle and for cos_pole, which it is made of"),
        ({"cart": [1, 2], "cart_velocity": [0, 0, 0]}, "for 2 and 3 states"),
        ([np.nan] * 5, "NaN in every component"),
        ([0, np.inf, 0, 0, 0], "inf in cos_pole: it must be finite"),
    ],
)
def test_a_goal_that_asks_for_what_there_is_not(cartpole, goal, message):
    with pytest.raises(EverystateError, match=message):
        cartpole.act(HANGING, goal)


def test_nothing_is_free_in_an_observation(cartpole):
    with pytest.raises(EverystateError, match="observation is nan in cart"):
        cartpole.act([np.nan, 1, 0, 0, 0], HANGING)


def test_what_is_asked_is_in_the_whole_goal(cartpole):
    goal = cartpole.complete(HANGING, {"pole_angle": 30, "cart_velocity": 0.5})
    assert goal[[1, 2, 3]] == pytest.approx([np.cos(np.pi / 6), 0.5, 0.5], abs=1e-4)
    same = cartpole.complete(HANGING, [np.nan, np.cos(np.pi / 6), 0.5, 0.5, np.nan])
    assert same[[1, 2, 3]] == pytest.approx(goal[[1, 2, 3]], abs=1e-4)
    nearly = cartpole.complete(HANGING, {"cos_pole": 0.95, "sin_pole": 0.0})
    assert nearly[1] == pytest.approx(1, abs=1e-4)  # a cosine and sine of length 1


def test_all_that_an_agent_says_is_of_the_goal_that_it_makes(cartpole):
    asked = {"pole_angle": 0, "cart": -0.5}
    whole = cartpole.complete(HANGING, asked)
    for method in (cartpole.act, cartpole.value, cartpole.steps_to_goal):
        np.testing.assert_allclose(method(HANGING, asked), method(HANGING, whole), atol=1e-3)


def test_a_whole_state_by_name_is_that_state(cartpole):
    named = dict(zip(cartpole.state_names, [0.5, 1, 0, 0, 0], strict=True))
    assert np.array_equal(cartpole.act(HANGING, named), cartpole.act(HANGING, [0.5, 1, 0, 0, 0]))


def test_batches(cartpole):
    states = np.array([HANGING, [-0.2, -1, 0, 0, 0]], np.float32)
    one = [cartpole.complete(s, {"pole_angle": a}) for s, a in zip(states, [10, 20], strict=True)]
    both = cartpole.complete(states, {"pole_angle": [10, 20]})
    np.testing.assert_allclose(both, one, atol=1e-4)
    assert cartpole.act(states, {"pole_angle": 10}).shape == (2, 1)
    assert cartpole.act(HANGING, {"pole_angle": [10, 20, 30]}).shape == (3, 1)
    with pytest.raises(EverystateError, match="2 observations and 3 goals"):
        cartpole.act(states, {"pole_angle": [10, 20, 30]})


def test_an_ant_is_sent_by_what_people_say():
    ant, standing = everystate.load("ant"), np.array(state(STANDS), np.float32)
    asked = {"height": 0.6, "heading": 90, "forward_velocity": 0.5}
    (part,) = parts(ant.state_names)
    found = part.read(ant.complete(standing, asked))
    assert {name: found[name] for name in asked} == pytest.approx(asked, abs=1e-2)


def choose(*, calm: list[bool], near: list[float], held: list[float]) -> float:
    """The free second component of the completion of x = 1, of three states and the present.

    By stand-ins for V: `near` of passing a goal from here, `held` of holding it from here, and of
    each goal whether it can be held, by its free component: 1, 2, 3, and 0 of the present.
    """
    config = replace(preset("any"), discount=0.99)
    tables = jnp.array(near, float), jnp.array(held, float), jnp.array(calm)

    def at(goal: Any, table: Any) -> Any:
        return table[jnp.round(goal[1]).astype(int)]

    def hold(s: Any, g: Any) -> Any:
        return jnp.where((s == g).all(), jnp.where(at(g, tables[2]), 0.0, -50.0), at(g, tables[1]))

    def passes(_: Any, g: Any) -> Any:
        return at(g, tables[0])

    none: Any = None
    models = Models(none, none, none, none, (hold, passes))  # pyright: ignore[reportArgumentType]
    states = jnp.stack([jnp.ones(40), 1.0 + jnp.arange(40.0) % 3], axis=1)
    atlas = Atlas(states, jnp.array(calm)[states[:, 1].astype(int)])
    here, asked = jnp.array([5.0, 0.0]), jnp.array([1.0, jnp.nan])
    unit = Scale(jnp.zeros(2), jnp.ones(2))
    goal = completed(config, models, unit, (), atlas, here, asked, {})
    assert goal[0] == 1
    return float(goal[1])


def test_what_can_be_held_comes_first_and_of_it_what_costs_least():
    assert choose(calm=[False, True, True, False], near=[9, 1, 2, 8], held=[0, -30, -20, -1]) == 2


def test_where_nothing_can_be_held_the_nearest_is_passed():
    assert choose(calm=[False] * 4, near=[1, 2, 3, 9], held=[0, 0, 0, -40]) == 3


def test_the_present_state_is_a_choice_too():
    assert choose(calm=[True] * 4, near=[0, 0, 0, 0], held=[-1, -5, -6, -7]) == 0
