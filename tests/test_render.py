"""Films show what was recorded: as long, as large and as lively; and take no other file's place."""

import dataclasses
import re
import subprocess
from pathlib import Path

import imageio.v2 as imageio
import imageio_ffmpeg
import mujoco
import numpy as np
import pytest

from everystate import cli, load, viewing
from everystate.agent import Agent
from everystate.envs import make
from everystate.envs.rendering import Along, overview
from everystate.errors import EverystateError
from everystate.viewing import recording, video

SIZE = (160, 120)


@pytest.fixture(scope="module")
def agent() -> Agent:
    return load("ramp-pointmass")


def test_a_recording_says_what_was_done_and_thought() -> None:
    agent = load("cartpole")  # which balances from every start
    recorded = recording.record_skill(agent, "balance", plan=False, seed=0)
    assert recorded.title == "balance, by the policy: done"
    assert recorded.states.shape == recorded.goals.shape == (626, 5)
    assert recorded.distance[0] > 2
    assert recorded.distance[-5:].max() < 0.5
    np.testing.assert_allclose(
        recorded.steps_to_goal[0],
        agent.steps_to_goal(recorded.states[0], recorded.goals[0]),
        rtol=1e-4,
    )


def test_exploring_goes_to_several_goals_of_its_own(agent: Agent) -> None:
    recorded = recording.record_exploration(agent, steps=50, plan=False, seed=1)
    assert len(np.unique(recorded.goals, axis=0)) == recording.EXPLORED
    assert recorded.states.shape == (51, 2)
    again = recording.record_exploration(agent, steps=50, plan=False, seed=1)
    np.testing.assert_array_equal(recorded.states, again.states)


def decoded(path: Path, width: int, height: int) -> tuple[np.ndarray, float]:
    """All frames of a video, and how many a second."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo"]
    done = subprocess.run([*command, "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
    rate = re.search(r"([\d.]+) fps", done.stderr.decode())
    assert rate is not None
    frames = np.frombuffer(done.stdout, dtype=np.uint8).reshape(-1, height, width, 3)
    return frames.astype(int), float(rate[1])


def test_a_video_moves_in_real_time_and_says_what_v_thinks(tmp_path: Path) -> None:
    path = viewing.render(
        "ramp-pointmass", tmp_path / "a.mp4", skill="climb", size=SIZE, plan=False
    )
    frames, rate = decoded(path, 160, 200)
    assert rate == pytest.approx(1 / 0.06, abs=0.01)
    assert len(frames) == 121
    picture, below = frames[:, :120], frames[:, 120:]
    red = (picture[..., 0] > 150) & (picture[..., 1:].max(axis=-1) < 90)
    at = [np.argwhere(one).mean(axis=0) for one in red[:25:6] if one.any()]
    assert len(at) >= 3
    assert np.abs(np.diff(at, axis=0)).max() > 3  # the ball has rolled
    cursor = (below[..., 0] > 160) & (below[..., 2] < 60)
    first, last = (np.argwhere(cursor[i])[:, 1].min() for i in (1, -1))
    assert last - first > 40


def test_a_gif_and_a_filmstrip(tmp_path: Path) -> None:
    options = {"goal": (0.5, -0.5), "steps": 20, "size": SIZE, "plan": False}
    gif = viewing.render("ramp-pointmass", tmp_path / "a.gif", **options)
    frames = imageio.mimread(gif)
    assert len(frames) == 21  # every one, of about 17 a second
    assert frames[0].shape[:2] == (200, 160)
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 100
    strip = imageio.imread(viewing.render("ramp-pointmass", tmp_path / "a.png", **options))
    assert strip.shape[0] > 300


def test_a_film_plans_if_told_to_or_else_if_the_agent_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, agent: Agent
) -> None:
    planned: list[bool] = []

    def record(*_: object, plan: bool, **__: object) -> None:
        planned.append(plan)
        raise EverystateError("enough")

    monkeypatch.setattr(recording, "record_exploration", record)
    plans = dataclasses.replace(agent, act_with="plan").export(tmp_path / "plans")
    for run in ("ramp-pointmass", plans):
        for words in ([], ["--plan"], ["--no-plan"]):
            out = str(tmp_path / "a.mp4")
            assert cli.main(["render", str(run), "--out", out, *words]) == 2
    assert planned == [False, True, False, True, True, False]


def test_nothing_is_overwritten_and_nothing_half_made_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, agent: Agent
) -> None:
    mine = tmp_path / "mine.mp4"
    mine.write_text("mine")
    with pytest.raises(EverystateError, match=r"mine\.mp4 is there already: remove it"):
        viewing.render("ramp-pointmass", mine, steps=5)
    env = recording.body_of(agent)
    recorded = recording.record_goal(agent, (0.0, 0.0), steps=5, plan=False, seed=0)

    def broken(*_: object) -> None:
        raise EverystateError("no EGL")

    monkeypatch.setattr(type(env), "render_states", broken)
    with pytest.raises(EverystateError, match="no EGL"):
        video.write(recorded, env, tmp_path / "other.mp4")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.mp4"]
    assert mine.read_text() == "mine"


def test_the_command_names_the_file_it_wrote(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    small = ["--steps", "6", "--size", "160", "120", "--no-plan"]
    assert cli.main(["render", "ramp-pointmass", "--goal", "0", "-0.5", *small]) == 0
    assert capsys.readouterr().out == "ramp-pointmass-goal.mp4\n"
    assert Path("ramp-pointmass-goal.mp4").stat().st_size > 500
    assert cli.main(["render", "ramp-pointmass", "--goal", "0", "-0.5", *small]) == 2
    assert "is there already" in capsys.readouterr().err


def test_a_film_without_ffmpeg_is_refused_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(tmp_path / "none"))
    with pytest.raises(EverystateError, match="apt-get install ffmpeg"):
        video.check_target(tmp_path / "a.mp4")
    assert video.check_target(tmp_path / "a.gif") == tmp_path / "a.gif"


def test_a_body_that_says_nothing_of_its_looks_is_seen_whole_above_a_floor() -> None:
    env = make(str(Path(__file__).parents[1] / "experiments" / "arm.xml"), 1, 0)
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    states = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    frames = env.render_states(states, None, *SIZE)
    assert (frames[:, 2:-2, 2:-2].min(axis=(1, 2, 3)) < 130).all()
    for edge in (frames[:, 0], frames[:, -1], frames[:, :, 0], frames[:, :, -1]):
        assert edge.min() > 190
    assert frames[:, 0].min() > 240  # the sky
    assert frames[:, -1].max() < 235  # the floor
    assert len(np.unique(frames.reshape(8, -1), axis=0)) == 8


def test_a_free_body_is_followed_and_has_no_floor_that_would_not_hold_it(tmp_path: Path) -> None:
    path = tmp_path / "box.xml"
    xml = """<mujoco><worldbody><body name="box"><freejoint/><geom type="box" size=".1 .1 .1"/>
      <body><joint name="arm"/><geom size=".05"/></body></body></worldbody>
      <actuator><motor joint="arm"/></actuator></mujoco>"""
    path.write_text(xml)
    env = make(str(path), 1, 0)
    high, low = env.reset(seed=0)[0].repeat(2, axis=0)
    low[0] = high[0] - 3.0
    frames = env.render_states(np.stack([high, low]), None, *SIZE).astype(int)
    assert np.abs(frames[0] - frames[1]).mean() < 1  # in the middle both times
    assert frames[0].min() < 130
    assert frames[0, -1].min() > 240
    path.write_text(xml.replace("<worldbody>", '<worldbody><geom type="plane" size="5 5 1"/>'))
    grounded = make(str(path), 1, 0).render_states(high[None] + 0.0, None, *SIZE)[0]
    assert 190 < grounded[-1].min() < 235


def test_a_body_without_shapes_has_a_view_too() -> None:
    xml = """<mujoco><worldbody><body><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    </body></worldbody></mujoco>"""
    camera = overview(mujoco.MjModel.from_xml_string(xml))
    assert camera.distance > 0
    assert np.isfinite(camera.lookat).all()


def test_an_ant_is_where_it_has_got_to_and_leaves_a_trail() -> None:
    """It does not observe where it is: a path of states says where they lead."""
    env = make("ant", 1, 0)
    state = env.reset(seed=0)[0][0]
    moving = state.copy()
    moving[list(env.state_names).index("torso_vx")] = 2.0
    path, at = np.tile(moving, (26, 1)), np.array([0, 25])
    still = env.render_states(path[at], None, *SIZE)
    assert np.abs(still[0].astype(int) - still[1]).mean() < 1
    gone = env.render_states(path[at], None, *SIZE, along=Along(path, at)).astype(int)
    trail = (gone[..., 0] > 150) & (gone[..., 2] < 60) & (gone[..., 1] > 60)
    assert trail[1].sum() > trail[0].sum() + 5
    # The camera goes along: what is under the ant has changed, and not the ant.
    assert np.abs(gone[1] - still[1]).max() > 50
    middle = np.s_[50:70, 70:90]
    red = [(one[middle][..., 0] - one[middle][..., 1:].max(axis=-1) > 60).sum() for one in gone]
    assert red[0] > 0
    assert abs(red[1] - red[0]) <= 0.3 * red[0]
