"""The studio: the life of a body without its page, and its page in a real browser."""

import dataclasses
import os
import re
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
import pytest
from viser.transforms import SO3

from browsing import opened
from everystate import load
from everystate.envs import MujocoVectorEnv, make
from everystate.errors import EverystateError
from everystate.skills import skill
from everystate.viewing.pursuit import Pursuit
from everystate.viewing.shapes import shell, solid
from everystate.viewing.snippet import as_python
from everystate.viewing.studio import Studio
from everystate.viewing.world import World
from waiting import until

SIZES = (1000, 700), (1280, 800), (1600, 1000)
ARTEFACTS = Path(os.environ.get("EVERYSTATE_ARTEFACTS", "artefacts"))


@pytest.fixture
def world() -> World:
    return World(load("ramp-pointmass"))


def test_it_goes_where_it_is_sent_and_stays(world: World) -> None:
    world.send(np.array([-0.9, -0.9]))
    for _ in range(60):
        world.step()
    thoughts = world.thoughts()
    assert thoughts.distance[-1] < 0.5 < thoughts.distance[-60]
    assert thoughts.steps_to_goal[-1] < thoughts.steps_to_goal[-60]
    steps = world.agent.steps_to_goal(world.state, world.goal)
    assert thoughts.steps_to_goal[-1] == pytest.approx(steps, abs=1e-4)
    assert np.isfinite(thoughts).all()
    assert world.pursuit.reached is not None
    assert world.pursuit.told(0.06) == f"reached in {0.06 * world.pursuit.reached:.1f} s"
    world.send(np.array([-1.0, 1.0]))
    world.step()
    assert world.pursuit.told(0.06) == "on its way, 0.1 s"


def test_where_it_travels_is_known_though_it_does_not_observe_it(world: World) -> None:
    assert world.trail is None
    ant = World(load("ant"))
    ant.perform("walk-forward-by-gait")
    for _ in range(40):
        ant.step()
    assert ant.trail is not None
    assert ant.trail.shape == (250, 2)
    np.testing.assert_array_equal(ant.trail[:210], np.zeros((210, 2)))
    steps = np.linalg.norm(np.diff(ant.trail[-41:], axis=0), axis=1)
    assert 0.05 < steps.sum() < 3
    assert steps.max() < 0.2


def test_it_plans_if_told_to_or_else_if_the_agent_says_so(world: World) -> None:
    assert not world.plan
    assert World(world.agent, plan=True).plan
    plans = dataclasses.replace(world.agent, act_with="plan")
    assert World(plans).plan
    assert not World(plans, plan=False).plan


def test_a_skill_goes_through_its_goals_and_keeps_the_last(world: World) -> None:
    world.perform("come-back")
    goals = []
    for _ in range(160):
        goals.append(tuple(round(float(x), 2) for x in world.goal))
        world.step()
    assert list(dict.fromkeys(goals)) == [(0.75, 0.8), (0.75, -0.8), (-0.3, -0.3)]
    world.send(np.array([0.0, 0.0]))
    assert world.goal.tolist() == [0.0, 0.0]


def test_a_skill_is_told_done_as_soon_as_its_rule_is_fulfilled() -> None:
    world = World(load("cartpole"))
    world.perform("pass-top")
    assert world.pursuit.told(0.02).startswith("0.0 of ")
    while not world.pursuit.over:
        world.step()
        world.pursuit.judge(world.env)
        if world.pursuit.reached is not None:
            break
    assert world.pursuit.steps == world.pursuit.reached
    assert 5 <= world.pursuit.steps < 250
    assert world.pursuit.told(0.02) == f"done in {0.02 * world.pursuit.steps:.1f} s"


def test_a_skill_that_fell_or_ran_out_of_time_is_told_not_done() -> None:
    env = make("ramp-pointmass", 1, 0)
    up = np.array([[-0.9, -0.9], *([[0.0, 0.8]] * 120)], dtype=np.float32)
    fell = up.copy()
    fell[50] = [0.0, 0.0]
    for way, told in ((up, "done in 0.3 s"), (fell, "not done in 7.2 s")):
        pursuit = Pursuit("climb", skill("ramp-pointmass", "climb"), [way[0]])
        for state in way[1:]:
            pursuit.goes_on(state, 0.0)
            pursuit.judge(env)
        assert pursuit.told(0.06) == told


def test_starting_over_forgets_its_way(world: World) -> None:
    world.perform("climb")
    for _ in range(20):
        world.step()
    world.restart()
    assert world.pursuit.told(0.06) == "on its way, 0.0 s"
    np.testing.assert_array_equal(world.goal, world.state)
    np.testing.assert_array_equal(world.thoughts().distance, np.zeros(250))
    with pytest.raises(EverystateError, match="nothing to film: let it live"):
        world.recording()


def test_what_it_did_last_can_be_filmed(world: World) -> None:
    world.perform("climb")
    for _ in range(30):
        world.step()
    recorded = world.recording()
    assert recorded.states.shape == recorded.goals.shape == (31, 2)
    np.testing.assert_array_equal(recorded.states[-1], world.state)
    assert recorded.distance.shape == recorded.steps_to_goal.shape == (31,)
    for _ in range(230):
        world.step()
    assert len(world.recording().states) == 250


def test_a_pull_moves_the_point_that_is_pulled_after_the_hand(world: World) -> None:
    world.send(np.array([0.0, 0.0]))
    before = world.state
    world.pull(ball(world), np.array([*before, 0.05]), np.array([before[0] + 0.2, before[1], 0.05]))
    assert 0.05 < world.state[0] - before[0] < 0.25
    assert world.state[1] == pytest.approx(before[1], abs=1e-6)
    cartpole = World(load("cartpole"))
    for side in (-1, 1):
        cartpole.restart()
        place, cosine, sine, moving, turning = cartpole.state
        assert cosine < 0  # it hangs
        tip = np.array([place + sine, 0.0, 1.0 + cosine])
        cartpole.pull(ball(cartpole), tip, tip + np.array([0.3 * side, 0.0, 0.0]))
        after = cartpole.state
        np.testing.assert_allclose(after[:3], (place, cosine, sine), atol=1e-5)
        assert -side * (after[4] - turning) > 0.5
        assert abs(after[3] - moving) < 0.1
        cart = np.array([place, 0.0, 1.0])
        cartpole.pull(ball(cartpole) - 1, cart, cart + np.array([0.3 * side, 0.0, 0.0]))
        assert side * (cartpole.state[3] - after[3]) > 0.5


def test_a_pull_is_bounded(world: World) -> None:
    before = world.state
    place = np.array([*before, 0.05])
    with pytest.raises(EverystateError, match="both must be finite"):
        world.pull(ball(world), place, np.array([np.nan, 0.0, 0.0]))
    np.testing.assert_array_equal(world.state, before)
    cartpole = World(load("cartpole"))
    cartpole.pull(ball(cartpole), np.array([0.0, 0.0, 1.0]), np.array([1e30, 0.0, 1.0]))
    assert np.abs(cartpole.state).max() < 100
    cartpole.step()


def ball(world: World) -> int:
    """The last of the bodies that can move."""
    assert isinstance(world.env, MujocoVectorEnv)
    return int(np.flatnonzero(world.env.model.body_weldid)[-1])


def test_what_it_plans_is_known_while_it_plans(world: World) -> None:
    world.send(np.array([0.4, -0.6]))
    world.step()
    assert world.ahead is None
    assert not world.pursuit.search
    world.plan = True
    before = world.state
    world.step()
    share = "100" if world.pursuit.corrected else "0"
    assert world.pursuit.search == f"planning corrects {share} % of its steps"
    assert world.ahead is not None
    assert world.ahead.shape == (9, 2)
    np.testing.assert_allclose(world.ahead[0], before, atol=1e-5)
    np.testing.assert_allclose(world.ahead[1], world.state, atol=0.15)  # its actions are noisy
    world.plan = False
    world.step()
    assert world.ahead is None


@pytest.mark.parametrize("plan", [False, True])
def test_as_a_program_it_goes_to_the_same_goal(plan: bool) -> None:
    world = World(load("ramp-pointmass"), plan=plan)
    world.send(np.array([0.25, -0.5]))
    left: dict[str, Any] = {}
    code = as_python(world, "ramp-pointmass").replace("range(250)", "range(40)")
    assert ("plan=True" in code) == plan
    exec(compile(code, "snippet", "exec"), left)
    assert left["goal"] == [0.25, -0.5]
    assert np.abs(left["observations"] - left["goal"]).max() < 0.3


def test_a_part_of_a_state_is_pursued_alone_and_its_whole_shown(world: World) -> None:
    world.send({"y": -0.5}, "y=-0.5")
    for _ in range(40):
        world.step()
    assert abs(world.state[1] + 0.5) < 0.2
    assert world.pursuit.reached is not None
    assert world.goal[1] == pytest.approx(-0.5)
    off = abs(world.state[1] + 0.5) / world.agent.units["y"].spread
    assert world.thoughts().distance[-1] == pytest.approx(off, abs=1e-5)
    with pytest.raises(EverystateError, match="'z'"):
        world.send({"z": 1})
    assert world.asked == {"y": -0.5}  # as before
    left: dict[str, Any] = {}
    code = as_python(world, "ramp-pointmass").replace("range(250)", "range(40)")
    exec(compile(code, "snippet", "exec"), left)
    assert left["goal"] == {"y": -0.5}
    assert abs(left["observations"][0, 1] + 0.5) < 0.2


def test_what_is_drawn_is_smooth_and_no_two_faces_lie_in_each_other() -> None:
    env = make("ant", 1, 0)
    assert isinstance(env, MujocoVectorEnv)
    torso = solid(env.model, [1])
    size = env.model.geom_size[1, 0]
    radii = np.linalg.norm(torso.vertices, axis=1)
    assert torso.faces.shape == (5120, 3)
    assert np.ptp(radii) < 1e-6 * size
    np.testing.assert_allclose(torso.vertex_normals, torso.vertices / radii[:, None], atol=5e-3)
    around, _ = shell(env.model, [1], 1.0)
    assert np.linalg.norm(around, axis=1).min() > 1.02 * size
    parts = [int(np.flatnonzero(env.model.geom_bodyid == i)[0]) for i in (3, 4)]
    leg, foot = (solid(env.model, [geom]).extents.min() for geom in parts)
    assert abs(leg - foot) > 0.01 * leg  # they share the ball of the ankle


def test_pushes_and_weights_move_it_but_not_out_of_its_world(world: World) -> None:
    for _ in range(20):
        before = world.state
        world.push()
        assert not np.array_equal(before, world.state)
        assert np.abs(world.state).max() <= 1
    before = world.state
    world.weigh(2.0)
    np.testing.assert_array_equal(world.state, before)
    world.step()
    with pytest.raises(EverystateError, match=r"mass is 9\.0: choose 0\.25 to 4"):
        world.weigh(9.0)
    world.weigh(1.0)


def test_goals_it_is_surprised_by_differ_and_can_be_repeated(world: World) -> None:
    same = World(load("ramp-pointmass"))
    for choose in ("surprise", "anywhere"):
        goals = []
        for _ in range(3):
            getattr(world, choose)()
            getattr(same, choose)()
            np.testing.assert_array_equal(world.goal, same.goal)
            goals.append(world.goal.copy())
        assert len(np.unique(goals, axis=0)) == 3


def test_what_cannot_be_drawn_is_said(tmp_path: Path) -> None:
    with pytest.raises(EverystateError, match="no agent at"):
        Studio(tmp_path / "none", port=0)
    with pytest.raises(EverystateError, match="port 99999 is none"):
        Studio("ramp-pointmass", port=99999)


@pytest.fixture(scope="module")
def studio() -> Iterator[Studio]:
    page = Studio("ramp-pointmass", port=0)
    yield page
    page.close()


def test_the_page_is_for_this_machine_alone(studio: Studio) -> None:
    assert studio.address.startswith("http://127.0.0.1:")
    taken = int(studio.address.rpartition(":")[2])
    with pytest.raises(EverystateError, match=f"port {taken} of 127.0.0.1 cannot be had"):
        Studio("ramp-pointmass", port=taken)


@pytest.mark.browser
def test_the_page_asks_nobody_else_and_a_button_sends_the_body(
    browser: Any, studio: Studio
) -> None:
    page, asked = opened(browser, studio)
    page.get_by_role("button", name="climb").click()
    until(lambda: studio.world.goal.tolist() == pytest.approx([0.0, 0.8]))
    until(lambda: studio.world.thoughts().distance[-1] < 0.5)
    assert asked
    local = (studio.address, studio.address.replace("http", "ws"), "data:", "blob:")
    assert [url for url in asked if not url.startswith(local)] == []
    page.close()


@pytest.mark.browser
def test_the_panel_is_beside_the_body_however_wide_the_page(browser: Any, studio: Studio) -> None:
    page, _ = opened(browser, studio)
    page.get_by_role("button", name="climb").click()
    page.get_by_text("done in").wait_for()
    ARTEFACTS.mkdir(exist_ok=True)
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})

        def beside(width: int = width) -> bool:
            scene = page.locator("canvas").first.bounding_box()
            button = page.get_by_role("button", name="climb").bounding_box()
            inside = button["x"] + button["width"] <= width
            return inside and width // 2 < scene["x"] + scene["width"] <= button["x"]

        until(beside)
        page.screenshot(path=ARTEFACTS / f"studio-{width}.png")
    page.close()


@pytest.mark.browser
@pytest.mark.parametrize(("run", "skill"), [("cartpole", "balance"), ("ant", "recover")])
def test_other_bodies_are_seen_at_work(browser: Any, run: str, skill: str) -> None:
    studio = Studio(run, port=0, plan=run == "cartpole")
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(120_000)
    page.goto(studio.address)
    page.get_by_role("button", name=skill, exact=True).click()
    # The ant is up in 1.7 s, which a page that draws slowly may not show.
    page.get_by_text(re.compile(r"of (25|10)\.0 s|done in")).wait_for()
    until(lambda: studio.world.pursuit.steps > 60)
    page.screenshot(path=ARTEFACTS / f"studio-{run}.png")
    page.close()
    studio.close()


@pytest.mark.browser
def test_a_key_starts_over_and_a_film_and_a_program_can_be_taken(
    browser: Any, studio: Studio, tmp_path: Path
) -> None:
    page, _ = opened(browser, studio)
    studio.world.send(np.array([0.0, 0.8]))
    until(lambda: studio.world.steps > 20)
    with page.expect_download() as taken:
        page.get_by_role("button", name="GIF").click()
    taken.value.save_as(tmp_path / "film.gif")
    assert len(imageio.mimread(tmp_path / "film.gif")) > 10
    page.get_by_role("button", name="Python").click()
    program = page.locator("pre")
    program.wait_for()
    assert "0.8,  # y, m" in program.inner_text()
    page.get_by_role("button", name="Copy").click()
    assert program.evaluate("code => getSelection().toString()").startswith("import everystate")
    page.get_by_role("button", name="Close").click()
    page.keyboard.press("r")
    until(lambda: studio.world.pursuit.name == "stay here")
    page.close()


@pytest.mark.browser
def test_the_mouse_pulls_the_body(browser: Any, studio: Studio) -> None:
    page, _ = opened(browser, studio)
    page.keyboard.press("Space")
    until(lambda: studio._panel.paused)
    (client,) = studio._server.get_clients().values()
    (drawn,) = (studio._stage._bodies[index] for index in studio._stage._ghosts)
    scene = page.locator("canvas").first.bounding_box()
    at = pixel(client.camera, drawn.position, scene)
    before = studio.world.state
    page.mouse.move(*at)
    page.mouse.down()
    for far in (10, 30, 60):
        page.mouse.move(at[0] - far, at[1])
    page.mouse.up()
    until(lambda: np.linalg.norm(studio.world.state - before) > 0.02)
    page.keyboard.press("Space")
    until(lambda: not studio._panel.paused)
    page.close()


def pixel(camera: Any, point: np.ndarray, scene: Any) -> tuple[float, float]:
    """Where on the page a point of the scene is seen."""
    forth = SO3(camera.wxyz).inverse() @ (np.asarray(point) - camera.position)
    focal = scene["height"] / 2 / np.tan(camera.fov / 2)
    x, y = focal * forth[:2] / forth[2]
    middle = scene["x"] + scene["width"] / 2, scene["y"] + scene["height"] / 2
    return middle[0] + float(x), middle[1] + float(y)


@pytest.mark.browser
def test_two_browsers_at_once_and_one_that_leaves(browser: Any, studio: Studio) -> None:
    one, _ = opened(browser, studio)
    other, _ = opened(browser, studio)
    one.close()
    before = studio.world.steps
    other.get_by_role("button", name="stay here").click()
    until(lambda: studio.world.steps > before + 10)
    until(lambda: np.abs(studio.world.goal - studio.world.state).max() < 0.3)
    other.close()


@pytest.mark.browser
def test_a_page_for_others_asks_for_the_token_once(browser: Any) -> None:
    studio = Studio("ramp-pointmass", host="0.0.0.0", port=0)
    try:
        page = browser.new_page()
        page.goto(studio.address.partition("?")[0].replace(socket.gethostname(), "127.0.0.1"))
        page.locator("input[name=token]").fill(str(studio.gate.token))
        page.get_by_role("button", name="Open").click()
        page.get_by_role("button", name="climb").click(timeout=60_000)
        assert "token" not in page.url
        until(lambda: studio.world.goal.tolist() == pytest.approx([0.0, 0.8]))
        page.close()
    finally:
        studio.close()
