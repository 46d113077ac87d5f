"""The page for newcomers does what it says: its files and its code are run."""

import re
import shutil
import sys
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import everystate
from everystate import cli, envs, evaluation
from everystate.envs.body import load_model
from everystate.errors import EverystateError
from everystate.learning.draws import Draws
from everystate.presets import preset
from everystate.training import bodies, loop
from everystate.training.learner import Learner
from everystate.training.rundir import default_run_dir
from everystate.viewing import recording, world
from test_training import CONFIG, contents, idle

PAGE = (Path(__file__).parents[1] / "docs" / "your-own-body.md").read_text()
SHORT = ["--preset", "test", "--epochs", "1", "--num-updates", "5", "--width", "8", "--quiet"]


def block(language: str, number: int = 0) -> str:
    """A code block of the page."""
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)[number]


def test_from_a_file_to_an_agent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(block("xml"))
    run = Path("runs/arm.xml-quick-seed0")
    assert f"everystate evaluate {run}" in PAGE
    assert default_run_dir(preset("quick", "arm.xml"), "quick") == run
    assert cli.main(["bodies", "arm.xml"]) == 0
    assert cli.main(["train", "arm.xml", "--run-dir", str(run), *SHORT]) == 0
    names: dict[str, Any] = {}
    exec(block("python"), names)
    Path("arm.xml").unlink()  # what follows needs the run's own copy only
    exec(block("python", 1), names)
    assert names["env"].body.xml == tmp_path / run / "body" / "arm.xml"
    assert cli.main(["evaluate", str(run), "--episodes", "3"]) == 0


def arm(length: float) -> str:
    """The page's arm, of another length."""
    changed = block("xml").replace("-0.5", f"{-length}")
    assert changed.count(f"0 0 0 0 0 {-length}") == 1
    return changed


def mass(agent: everystate.Agent) -> float:
    """Of the body that an agent's config says."""
    options = envs.parse_options(agent.config.body_options)
    env = envs.make(agent.config.body, 1, 0, **options)
    assert isinstance(env, envs.MujocoVectorEnv)
    assert env.name == agent.config.body
    return float(env.model.body_mass.sum())


def still() -> Learner:
    """A learner under which an arm hangs still, and which learns nothing."""
    zeros = jnp.zeros((CONFIG.steps_per_epoch, CONFIG.num_bodies, 3))
    action = jnp.zeros((CONFIG.num_bodies, 1))
    return idle()._replace(
        draw=lambda state: Draws(zeros, zeros[..., :1], zeros[..., 0].astype(int)),
        act=lambda actor, episodes, draws, observations: (episodes, action),
    )


def go_on(run: Path, body: str = "arm.xml") -> Path:
    """Trains, or goes on, without learning."""
    return everystate.train(body, preset="test", epochs=2, run_dir=run, progress=False)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run with an arm of length 0.5, in whose folder we are; it learned nothing."""
    monkeypatch.setattr(loop, "compiled", lambda config: still())
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.chdir(home)
    Path("arm.xml").write_text(arm(0.5))
    return go_on(home / "run")


def test_a_run_and_its_agent_keep_their_body_wherever_they_are(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = mass(everystate.load(run))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    Path("arm.xml").write_text(arm(2.0))
    other = envs.make("arm.xml", 1, 0)
    assert isinstance(other, envs.MujocoVectorEnv)
    assert float(other.model.body_mass.sum()) > 2 * own
    moved = run.rename(elsewhere / "moved")
    exported = everystate.load(moved).export(elsewhere / "exported")
    again = everystate.load(exported).export(elsewhere / "again")
    shutil.rmtree(exported)
    for place in (moved, max(moved.glob("checkpoints/*")), again):
        agent = everystate.load(place)
        assert agent.config.body == "arm.xml"
        assert mass(agent) == own
        assert str(tmp_path) not in (place / "body" / "body.json").read_text()
    assert str(tmp_path) not in (again / "agent.json").read_text()


def test_whatever_uses_an_agent_builds_its_own_body(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("arm.xml").write_text(arm(2.0))
    built = []

    def spy(xml: Path) -> mujoco.MjModel:
        built.append(xml)
        return load_model(xml)

    monkeypatch.setattr("everystate.envs.body.load_model", spy)
    agent = everystate.load(run)
    result = evaluation.evaluate(run, episodes=2, plan=False)
    assert result["body"] == "arm.xml"
    assert not any("model_copy" in option for option in result["config"]["body_options"])
    recording.record_goal(agent, [1.0, 0.0, 0.0], steps=2, plan=False, seed=0)
    studio = world.World(agent)
    studio.weigh(2.0)
    studio.anywhere()
    assert set(built) == {run / "body" / "arm.xml"}
    assert len(built) >= 5


def test_a_run_goes_on_with_the_body_it_began_with_only(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("arm.xml").write_text("<!-- the same arm, elsewhere -->" + arm(0.5))
    go_on(run)
    Path("arm.xml").write_text(arm(2.0))
    before = contents(run)
    with pytest.raises(EverystateError, match=r"learned on another arm\.xml than there is now"):
        go_on(run)
    Path("arm.xml").unlink()
    with pytest.raises(EverystateError, match=r"no MJCF file arm\.xml.*run/body has the file"):
        go_on(run)
    assert contents(run) == before


def test_a_run_learns_on_the_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From its first step on, so that it goes on with the same bits."""
    monkeypatch.setattr(loop, "compiled", lambda config: still())
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(arm(0.5))
    built, run = [], tmp_path / "run"

    def spy(env: envs.BodyVectorEnv, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert isinstance(env, envs.MujocoVectorEnv)
        built.append(env.body.xml)
        return step(env, actions)

    step = bodies._step
    monkeypatch.setattr(bodies, "_step", spy)
    go_on(run)
    assert set(built) == {run / "body" / "arm.xml"}


@pytest.mark.parametrize(
    ("name", "damage", "said"),
    [
        ("arm.xml", "gone", r"body/arm\.xml is missing"),
        ("arm.xml", "flipped", r"body/arm\.xml is not what it was"),
        ("body.json", "gone", r"body\.json"),
        ("body.json", "flipped", r"body\.json"),
    ],
)
@pytest.mark.filterwarnings("ignore:the agent in")  # each checkpoint has the same complaint
def test_a_damaged_copy_is_named(run: Path, name: str, damage: str, said: str) -> None:
    exported = everystate.load(run).export(run.with_name("exported"))
    for folder in (run, exported):
        path = folder / "body" / name
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
        if damage == "gone":
            path.unlink()
        with pytest.raises(EverystateError, match=said):
            mass(everystate.load(folder))
    with pytest.raises(EverystateError, match=rf"{said}|is not what it was"):
        go_on(run)
    shutil.rmtree(run / "body")
    with pytest.raises(EverystateError, match="run/body is missing"):
        go_on(run)


def test_a_class_of_ones_own_travels_without_its_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "compiled", lambda config: still())
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(arm(0.5))
    Path("my_arms.py").write_text(block("python", 2))
    monkeypatch.syspath_prepend(tmp_path)
    run = go_on(tmp_path / "run", "my_arms:Arm")
    Path("arm.xml").write_text(arm(2.0))
    agent = everystate.load(run)
    env = envs.make(agent.config.body, 1, 0, **envs.parse_options(agent.config.body_options))
    assert isinstance(env, envs.MujocoVectorEnv)
    del sys.modules["my_arms"]
    assert (env.name, env.body.xml) == ("my_arms:Arm", run / "body" / "arm.xml")
    assert env.model_hash == agent.body.model_hash
    assert sorted(p.name for p in (run / "body").iterdir()) == ["arm.xml", "body.json"]


def test_of_a_gymnasium_id_no_model_is_kept() -> None:
    env = envs.make("gymnasium:InvertedPendulum-v5", 1, 0)
    assert (env.model_hash, envs.own_model(env)) == ("", None)
    assert envs.versions("gymnasium:InvertedPendulum-v5").keys() == {"mujoco", "gymnasium"}
    assert "gymnasium-robotics" in envs.versions("gymnasium_robotics:FetchReach-v4")


def test_a_class_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(block("xml"))
    Path("my_bodies.py").write_text(block("python", 2))
    monkeypatch.syspath_prepend(tmp_path)
    env = envs.make("my_bodies:Arm", 4, 0)
    del sys.modules["my_bodies"]
    assert env.scaling.spread[2] == 8.0
    assert env.control_step == pytest.approx(0.02)
    assert set(env.regions(env.reset(seed=0)[0])) == {"down"}


@pytest.mark.parametrize("motor", ['ctrlrange="-1 1"', 'ctrlrange="-1 2"'])
def test_the_loop_of_a_robot_moves_it_as_training_did(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, motor: str
) -> None:
    monkeypatch.setattr(loop, "compiled", lambda config: still())
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(block("xml").replace('ctrlrange="-1 1"', motor))
    go_on(Path("runs/arm.xml-quick-seed0"))
    names: dict[str, Any] = {}
    exec(block("python", 4), names)
    agent, body, data = names["agent"], names["body"], names["data"]
    body.set_physics([{"qpos": [0.0], "qvel": [0.0]}])
    state = body.observe()
    for _ in range(50):
        state = body.step(agent.act(state, names["goal"]))[0]
    assert np.abs(data.qpos).max() > 0.001
    np.testing.assert_allclose(data.qpos, body.get_physics()[0]["qpos"], atol=1e-5)


def test_a_function_of_the_page_is_a_body(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    Path("my_envs.py").write_text(block("python", 3))
    env = envs.make("my_envs:pendulum", 1, 0, gravity=3.7)
    del sys.modules["my_envs"]
    assert isinstance(env, envs.GymnasiumVectorEnv)
    assert env.envs[0].unwrapped.g == 3.7  # pyright: ignore[reportAttributeAccessIssue]


def test_every_body_named_on_the_page_exists() -> None:
    named = re.findall(r"everystate train (\w+:\S+)", PAGE)
    assert len(named) == 7
    for body in named:
        if not body.startswith("my_"):
            assert len(envs.make(body, 1, 0).state_names) > 2
