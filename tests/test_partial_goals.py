"""Goals that ask for a part of a state, and the whole ones that an agent makes of them."""

import importlib
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import everystate
from everystate import goals, preset
from everystate.errors import EverystateError
from everystate.evaluation import suites
from everystate.features import parts
from everystate.learning import completion
from everystate.learning.completion import Atlas
from everystate.learning.models import Models, Scale
from everystate.skills.ant import STANDS, state
from everystate.viewing.recording import record_goal
from worlds import Known

measure = importlib.import_module("everystate.evaluation.measure")

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


def test_a_heading_leaves_the_velocity_in_the_world_as_asked():
    ant, standing = everystate.load("ant"), np.array(state(STANDS), np.float32)
    asked = {"heading": 90, "torso_vx": 0.5, "torso_vy": 0}
    acted = ant.act(standing, asked)
    whole = ant.complete(standing, asked)
    assert whole[[15, 16]] == pytest.approx([0.5, 0], abs=1e-5)
    np.testing.assert_allclose(acted, ant.act(standing, whole), atol=1e-4)


def choose(
    monkeypatch: pytest.MonkeyPatch,
    *,
    arrives: Mapping[int, int],
    leaves: Mapping[int, int] = MappingProxyType({}),
    promised: int | None = None,
) -> float:
    """The free second component of the completion of x = 1, of three states and the present.

    By stand-ins for d and the policy: after how many steps it gets to a goal, or never, and leaves
    it, or never. Goals go by their free component: 1, 2, 3, and 0 of the present. V promises to
    pass one of them later.
    """

    def when(table: Mapping[int, int], goal: Any) -> Any:
        every = jnp.array([table.get(i, 1000) for i in range(4)], jnp.int32)
        return every[jnp.round(goal[1]).astype(int)]

    def way(_: Any, act: Any, state: Any, latents: Any) -> Any:
        goal, step = act(jnp.int32(0), state), jnp.arange(len(latents) + 1, dtype=jnp.int32)
        there = (step >= when(arrives, goal)) & (step < when(leaves, goal))
        return jnp.where(there[:, None], goal, state)

    monkeypatch.setattr(completion, "rolled", way)
    monkeypatch.setattr(completion, "central", lambda config, models, state, goal: goal)
    none: Any = None
    promises: Any = (none, lambda _, goal: jnp.where(goal[1] == promised, 10.0, -10.0))
    models = Models(none, Known(), none, none, () if promised is None else promises)
    states = jnp.stack([jnp.ones(40), 1.0 + jnp.arange(40.0) % 3], axis=1)
    atlas = Atlas(states, jnp.zeros(40, bool))
    here, asked = jnp.array([5.0, 0.0]), jnp.array([1.0, jnp.nan])
    known = preset("quick"), models, Scale(jnp.zeros(2), jnp.ones(2))
    goal = completion.completed(*known, (), atlas, here, asked, {})
    assert goal[0] == 1
    return float(goal[1])


def test_of_what_fits_the_agent_goes_to_what_it_meets_soonest(monkeypatch):
    assert choose(monkeypatch, arrives={1: 7, 2: 3, 3: 12}) == 2


def test_or_to_what_it_can_keep(monkeypatch):
    assert choose(monkeypatch, arrives={1: 10, 2: 3}, leaves={2: 6}) == 1


def test_or_where_it_meets_nothing_yet_to_what_v_promises(monkeypatch):
    assert choose(monkeypatch, arrives={}, promised=3) == 3
    assert choose(monkeypatch, arrives={2: 3}, promised=3) == 2


def test_the_present_state_is_a_choice_too(monkeypatch):
    assert choose(monkeypatch, arrives={0: 1, 3: 2}) == 0


def test_an_agent_carries_states_that_it_has_visited(tmp_path, cartpole):
    seen = np.tile(np.array([0.5, 0, 1, 0, 0], np.float32), (1024, 1))
    exported = replace(cartpole, visited=seen).export(tmp_path / "agent")
    loaded = everystate.load(exported)
    assert loaded.visited is not None
    assert np.array_equal(loaded.visited, seen)
    np.testing.assert_allclose(loaded._atlas.states, seen, atol=1e-5)
    unseeing = replace(cartpole, visited=None)  # of a format before: it imagines what fits
    assert len(unseeing._atlas.states) == 4096


def test_a_checkpoint_has_visited_states(tmp_path):
    everystate.train(preset("test", epochs=1), run_dir=tmp_path / "run")
    agent = everystate.load(tmp_path / "run")
    assert agent.visited is not None
    assert agent.visited.shape == (1024, len(agent.state_names))
    assert np.ptp(agent.visited, axis=0).min() > 0


@pytest.mark.parametrize(
    ("words", "goal"),
    [
        (["1", "-2.5e-1"], (1.0, -0.25)),
        (["height=0.6", "forward_velocity=-.5"], {"height": 0.6, "forward_velocity": -0.5}),
    ],
)
def test_a_goal_as_it_is_written_on_the_command_line(words, goal):
    assert goals.read(words) == goal


@pytest.mark.parametrize("words", [["height=", "1"], ["1", "x=2"], ["x=1", "x=2"], ["up"], ["=1"]])
def test_words_that_are_no_goal(words):
    with pytest.raises(EverystateError, match="NAME=NUMBER"):
        goals.read(words)


def test_how_far_it_is_from_what_is_asked():
    names = ("cart", "cos_pole", "sin_pole")
    wanted, _ = goals.asked({"cart": 1.0, "pole_angle": 170.0}, names)
    state = np.array([[2.0, np.cos(np.radians(-170)), np.sin(np.radians(-170))]])
    off = goals.apart(state, wanted, names, np.array([2.0, 1.0, 1.0]))
    np.testing.assert_allclose(off, [[0.5, np.radians(20) * np.sqrt(3)]], atol=1e-5)


def test_a_suite_of_partial_goals_asks_for_no_more_and_scores_no_more(cartpole):
    suite = suites.load("cartpole", "parts", split="tune").subset(8)
    wanted = suite.asked(cartpole.state_names)
    assert np.array_equal(np.isnan(wanted), suite.weights == 0)
    assert ((~np.isnan(wanted)).sum(axis=1) <= 4).all()
    assert "parts" not in suites.names("cartpole")
    found = measure.measure(cartpole, suite, plan=False)
    assert found["score"]["all"] >= 0.75


def test_a_film_of_a_part_of_a_state_tells_the_distance_from_that_alone(cartpole):
    recorded = record_goal(cartpole, {"cart": 0.5}, steps=50, plan=False, seed=0)
    off = np.abs(recorded.states[:, 0] - 0.5) / cartpole.units["cart"].spread
    np.testing.assert_allclose(recorded.distance, off, atol=1e-5)
    assert recorded.goals[:, 0] == pytest.approx(0.5, abs=1e-5)
