"""Goals by the studio's sliders, ticks and keys: what they ask for, and in a real browser."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float

from browsing import opened
from everystate import goals, load
from everystate.envs import MujocoVectorEnv, make
from everystate.features import features
from everystate.viewing import sliders
from everystate.viewing.driving import ARROWS, can_drive, driven
from everystate.viewing.sliders import Slider
from everystate.viewing.studio import Studio
from waiting import until

ARTEFACTS = Path(os.environ.get("EVERYSTATE_ARTEFACTS", "artefacts"))
ANT = tuple(make("ant", 1, 0).state_names)
CARTPOLE = ("cart", "cos_pole", "sin_pole", "cart_velocity", "pole_velocity")
OWN = ["forward_velocity", "sideways_velocity", "turning_rate"]
QUAD = """<mujoco><worldbody><body name="trunk"><freejoint/><geom size="0.1"/>
<body pos="0.2 0 0"><joint name="knee" range="-1 1"/><geom size="0.1"/></body></body></worldbody>
<actuator><motor joint="knee"/></actuator></mujoco>"""


def groups(env: Any) -> dict[str, tuple[list[str], bool]]:
    """Names of sliders, and whether they begin unfolded."""
    assert isinstance(env, MujocoVectorEnv)
    far = np.ones(len(env.state_names))
    return {
        title: ([slider.name for slider in own], open)
        for title, (own, open) in sliders.grouped(env, -far, far).items()
    }


def every(env: Any) -> dict[str, Slider]:
    far = np.ones(len(env.state_names))
    found = sliders.grouped(env, -far, 2 * far).values()
    return {slider.name: slider for own, _ in found for slider in own}


def test_angles_take_the_place_of_cosines_and_rotation_matrices() -> None:
    assert groups(make("ramp-pointmass", 1, 0)) == {"position": (["x", "y"], True)}
    assert groups(make("cartpole", 1, 0)) == {
        "position": (["cart", "pole_angle"], True),
        "velocities": (["cart_velocity", "pole_velocity"], False),
    }
    ant = groups(make("ant", 1, 0))
    assert ant["pose"] == (["height", "heading", "pitch", "roll"], True)
    assert ant["joints"] == (list(ANT[7:15]), False)
    assert ant["velocities"] == ([*OWN, *ANT[15:]], False)


def test_without_a_heading_there_are_pitch_and_roll(tmp_path: Path) -> None:
    (tmp_path / "quad.xml").write_text(QUAD)
    quad = groups(make(str(tmp_path / "quad.xml"), 1, 0, heading=False))
    assert quad["pose"] == (["height", "pitch", "roll"], True)
    assert quad["joints"] == (["knee"], True)
    assert quad["velocities"][0][:3] == OWN


def test_they_reach_as_far_as_they_can_be_read() -> None:
    ant = every(make("ant", 1, 0))
    assert ant["pitch"][2:4] == (-90, 90)
    assert ant["heading"][2:4] == (-180, 180)
    assert ant["height"][2:4] == ant["forward_velocity"][2:4] == (-1, 2)
    assert ant["heading"].label == "heading (°)"
    assert ant["turning_rate"].label == "turning_rate (rad/s)"


def wandering(num: int = 20) -> Float[np.ndarray, "num 29"]:
    """States of an ant in any orientation, with any velocities."""
    rng = np.random.default_rng(0)
    states = rng.normal(size=(num, 29)).astype(np.float32)
    matrix = np.linalg.qr(rng.normal(size=(num, 3, 3)))[0]
    states[:, 1:7] = np.concatenate([matrix[:, :, 0], matrix[:, :, 1]], axis=1)
    return states


def test_all_that_tell_a_whole_state_ask_for_that_state() -> None:
    known = every(make("ant", 1, 0))
    whole = {name for name, slider in known.items() if not slider.besides}
    for before in wandering():
        told = sliders.values(before, ANT)
        goal = sliders.goal(known.values(), whole, told, ANT)
        np.testing.assert_allclose(np.asarray(goal), before, atol=1e-4)
        assert sliders.matter(known.values(), goal, ANT) == whole


def test_some_ask_for_what_they_say_and_no_more() -> None:
    known = every(make("cartpole", 1, 0))
    given = {"cart": 0.5, "pole_angle": 90.0, "cart_velocity": 1.0, "pole_velocity": 2.0}
    for asked in ({"pole_angle"}, {"cart", "pole_velocity"}):
        goal = sliders.goal(known.values(), asked, given, CARTPOLE)
        assert goal == {name: given[name] for name in asked}
        assert sliders.matter(known.values(), goal, CARTPOLE) == asked
    goal = sliders.goal(known.values(), given.keys(), given, CARTPOLE)
    assert goal == pytest.approx([0.5, 0, 1, 1, 2], abs=1e-6)


def test_what_was_asked_for_in_other_words_is_known() -> None:
    known = every(make("cartpole", 1, 0)).values()
    nan = np.nan
    assert sliders.matter(known, [nan, 1, 0, nan, nan], CARTPOLE) == {"pole_angle"}
    assert sliders.matter(known, {"cos_pole": 1.0}, CARTPOLE) == {"pole_angle"}


def test_what_says_the_same_in_other_words_excludes_it() -> None:
    known = every(make("ant", 1, 0))
    excluded = {
        (name, other)
        for name, slider in known.items()
        for other in known
        if not known[other].besides and slider.excludes(known[other])
    }
    going = {(way, f"torso_v{axis}") for way in OWN[:2] for axis in "xy"}
    assert excluded == going | {("turning_rate", f"torso_w{axis}") for axis in "xyz"}
    for name in features(ANT):  # as a goal by names has it
        beside = {n for n, s in known.items() if not s.besides and not known[name].excludes(s)}
        goals.asked(dict.fromkeys({name, *beside}, 0.0), ANT)


def test_a_body_that_goes_and_turns_can_be_driven() -> None:
    ant, cartpole = load("ant"), load("cartpole")
    assert can_drive(ant)
    assert not can_drive(cartpole)
    told = [[driven(ant, arrow, [0.0])[0] for arrow in line] for line in ARROWS]
    assert told == [
        ["forward left", "forward", "forward right"],
        ["left", "stand still", "right"],
        ["back left", "back", "back right"],
    ]
    pace, turn = ant.units["torso_vx"][1], ant.units["torso_wz"][1] / 2  # 1 and half a σ
    found = [driven(ant, arrow, [0.0])[1] for arrow in "↖→"]
    assert found[0] == pytest.approx({"forward_velocity": pace, "turning_rate": turn}, rel=1e-3)
    assert found[1] == pytest.approx({"forward_velocity": 0, "turning_rate": -turn}, rel=1e-3)
    before = {"height": 0.5, "torso_vx": 1.0, "torso_wz": 0.0, "forward_velocity": 3.0}
    expected = {"height": 0.5, "forward_velocity": -pace, "turning_rate": 0}
    assert driven(ant, "↓", before)[1] == pytest.approx(expected, rel=1e-3)


@pytest.fixture(scope="module")
def cartpole() -> Iterator[Studio]:
    page = Studio("cartpole", port=0)
    yield page
    page.close()


def test_all_or_nothing_can_matter(cartpole: Studio) -> None:
    goal, world = cartpole._panel.goal, cartpole.world
    assert goal.ticked == set(goal.sliders)
    goal.tick_none()
    asked = world.asked
    until(lambda: world.steps > 5)
    assert world.asked is asked  # it goes on to where it was sent
    world.send({"pole_angle": -90.0})
    until(lambda: goal.ticked == {"pole_angle"})
    until(lambda: goal.sliders["pole_angle"].value == -90)
    goal.tick_all()
    until(lambda: not isinstance(world.asked, dict))
    assert world.goal[1:3] == pytest.approx([0, -1], abs=1e-6)


@pytest.mark.browser
def test_what_is_ticked_matters_and_what_is_slid_is_ticked(browser: Any, cartpole: Studio) -> None:
    page, _ = opened(browser, cartpole)
    world, goal = cartpole.world, cartpole._panel.goal
    page.get_by_role("button", name="none").click()
    until(lambda: goal.ticked == set())
    page.get_by_label("cart (m)").check()
    until(lambda: isinstance(world.asked, dict) and set(world.asked) == {"cart"})
    field = page.get_by_role("textbox").nth(list(goal.sliders).index("pole_angle"))
    field.fill("90")
    field.press("Enter")
    until(lambda: isinstance(world.asked, dict) and world.asked.get("pole_angle") == 90)
    assert page.get_by_label("pole_angle (°)").is_checked()
    until(lambda: world.goal[1:3] == pytest.approx([0, 1], abs=1e-3))
    page.get_by_text("asked: ").wait_for()
    tick, slider = (
        page.get_by_label("cart (m)").bounding_box(),
        page.get_by_role("slider").nth(0).bounding_box(),
    )
    assert tick["x"] < slider["x"]
    assert abs(tick["y"] - slider["y"]) < 20  # on one line
    ARTEFACTS.mkdir(exist_ok=True)
    page.screenshot(path=ARTEFACTS / "studio-goal-cartpole.png")
    page.get_by_role("button", name="all").click()
    until(lambda: not isinstance(world.asked, dict))
    page.close()


@pytest.mark.browser
def test_a_slider_moves_the_ghost(browser: Any) -> None:
    studio = Studio("ramp-pointmass", port=0)
    page, _ = opened(browser, studio)
    field = page.get_by_role("textbox").nth(0)
    field.fill("-0.5")
    field.press("Enter")
    until(lambda: studio.world.goal[0] == pytest.approx(-0.5, abs=0.01))
    (ghost,) = studio._stage._ghosts.values()
    until(lambda: ghost.position[0] == pytest.approx(-0.5, abs=0.01))
    page.close()
    studio.close()


@pytest.mark.browser
def test_keys_drive_a_body_for_as_long_as_they_are_held(browser: Any) -> None:
    studio = Studio("ant", port=0)
    page, _ = opened(browser, studio)
    (client,) = studio._server.get_clients().values()
    seen = client.camera.position.copy()
    for keys, told in ((("w",), "forward"), (("a", "ArrowUp"), "forward left")):
        for key in keys:
            page.keyboard.down(key)
        until(lambda told=told: studio.world.pursuit.name == told)
    _, wanted = driven(studio.world.agent, "↖", {})
    assert studio.world.asked == wanted
    assert set(wanted) == {"forward_velocity", "turning_rate"}
    for key in ("w", "a"):
        page.keyboard.up(key)
    until(lambda: studio.world.pursuit.name == "forward")  # the arrow is still held
    until(lambda: studio._panel.goal.ticked == {"forward_velocity", "turning_rate"})
    page.screenshot(path=ARTEFACTS / "studio-drive-ant.png")
    page.keyboard.up("ArrowUp")
    until(lambda: studio.world.asked == {"forward_velocity": 0.0, "turning_rate": 0.0})
    np.testing.assert_array_equal(client.camera.position, seen)
    page.keyboard.down("d")
    until(lambda: studio.world.pursuit.name == "right")
    page.evaluate("window.dispatchEvent(new Event('blur'))")  # another window hears the key go up
    until(lambda: studio.world.pursuit.name == "stand still")
    page.get_by_role("button", name="↘").click()
    until(lambda: studio.world.pursuit.name == "back right")
    page.get_by_role("textbox").nth(0).click()
    page.keyboard.press("ArrowUp")  # changes the number
    until(lambda: set(studio._panel.goal.ticked) == {"height", "forward_velocity", "turning_rate"})
    page.keyboard.down("s")
    until(lambda: studio.world.pursuit.name == "back")
    asked: Any = studio.world.asked
    assert set(asked) == {"height", "forward_velocity", "turning_rate"}
    page.keyboard.up("s")
    page.close()
    studio.close()
