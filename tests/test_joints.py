"""Any MJCF file as a body: what is observed, and that a state can be put back."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from everystate.envs import JointBody, MujocoVectorEnv, make
from everystate.errors import EverystateError

ARM = """<mujoco><option timestep="0.005"/><worldbody>
  <body name="base"><freejoint name="base"/><geom size="0.1"/>
    <body pos="0.2 0 0"><joint name="elbow" range="-90 90" limited="true"/><geom size="0.05"/>
      <body pos="0.2 0 0"><joint name="wheel"/><geom size="0.05"/>
        <body pos="0 0.2 0"><joint name="rod" type="slide" range="0 1" limited="true"/>
          <geom size="0.05"/>
          <body pos="0 0.2 0"><joint name="ball" type="ball"/><geom size="0.05"/></body>
        </body></body></body></body>
</worldbody>
<actuator><motor joint="elbow"/>
  <position joint="rod" ctrllimited="true" ctrlrange="0 0.5"/></actuator></mujoco>"""

FREE = [f"base_{column}{axis}" for column in "xy" for axis in "xyz"]
BALL = [f"ball_{column}{axis}" for column in "xy" for axis in "xyz"]
POSE = ["base_z", *FREE, "elbow", "cos_wheel", "sin_wheel", "rod", *BALL]
SPEEDS = [f"base_{kind}{axis}" for kind in "vw" for axis in "xyz"]
SPEEDS += ["elbow_velocity", "wheel_velocity", "rod_velocity", "ball_wx", "ball_wy", "ball_wz"]


@pytest.fixture
def arm(tmp_path: Path) -> str:
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return str(path)


def test_components_follow_the_joints(arm: str) -> None:
    body = JointBody(Path(arm))
    assert list(body.state_names) == POSE + SPEEDS
    assert list(JointBody(Path(arm), travel=True).state_names) == [
        "base_x",
        "base_y",
        *POSE,
        *SPEEDS,
    ]
    units = dict(zip(body.state_names, body.state_units, strict=True))
    assert (units["base_z"], units["elbow"], units["cos_wheel"], units["rod"]) == (
        *("m", "rad"),
        *("1", "m"),
    )
    centre = dict(zip(body.state_names, body.centre, strict=True))
    assert (centre["elbow"], centre["rod"]) == (0.0, 0.5)
    assert np.isnan(centre["base_z"])
    assert body.frame_skip == 8  # 40 ms
    assert body.name == arm


def test_a_joint_without_a_name_has_that_of_its_body(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(
        ARM.replace('freejoint name="base"', "freejoint")
        .replace('joint name="wheel"', "joint")
        .replace('<body pos="0.2 0 0"><joint/>', '<body name="elbow" pos="0.2 0 0"><joint/>')
    )
    names = JointBody(path).state_names
    assert list(names[:7]) == ["base_z", *FREE]
    assert "cos_joint2" in names  # a joint has the name of this one's body already


SENSORS = """<sensor><framepos name="base" objtype="body" objname="base"/>
  <gyro name="turn" site="imu"/><touch site="imu"/><jointpos joint="elbow"/>
  <velocimeter site="imu"/></sensor></mujoco>"""


def test_sensors_are_observed_if_asked_for(arm: str, tmp_path: Path) -> None:
    path = tmp_path / "sensing.xml"
    imu = '<geom size="0.1"/><site name="imu"/>'
    path.write_text(ARM.replace('<geom size="0.1"/>', imu).replace("</mujoco>", SENSORS))
    plain, env = make(str(path), 2, 0), make(str(path), 2, 0, sensors=True)
    size = len(plain.state_names)
    names = ["base_x", "base_y", "sensor_base_z"]  # the joint has a base_z already
    names += [f"{n}_{axis}" for n in ("turn", "sensor4") for axis in "xyz"]
    # Not what depends on the action, nor what the joints say already.
    assert list(env.state_names) == [*plain.state_names, *names]
    assert env.state_units[size:] == (*["m"] * 3, *["rad/s"] * 3, *["m/s"] * 3)
    env.step(np.ones((2, 2)))
    observations, state = env.step(-np.ones((2, 2)))[0], env.get_state()
    place, (speed, turn) = state["qpos"][:, :3], np.split(state["qvel"][:, :6], 2, axis=1)
    np.testing.assert_allclose(observations[:, size : size + 3], place, rtol=1e-6)
    np.testing.assert_allclose(observations[:, size + 3 : size + 6], turn, rtol=1e-6)
    told = np.linalg.norm(observations[:, size + 6 :], axis=1)
    np.testing.assert_allclose(told, np.linalg.norm(speed, axis=1), rtol=1e-5)
    env.set_observations(observations)
    again = env.observe()[:, size + 3 :]  # where it has got to it was not told
    np.testing.assert_allclose(again, observations[:, size + 3 :], atol=1e-5)
    with pytest.raises(EverystateError, match=r"no sensor that can be observed.*framepos"):
        make(arm, 1, 0, sensors=True)


@pytest.mark.parametrize("travel", [False, True])
def test_a_state_can_be_put_back(arm: str, travel: bool) -> None:
    body = JointBody(Path(arm), travel=travel)
    rng = np.random.default_rng(0)
    qpos = rng.normal(size=(50, body.model.nq))
    qvel = rng.normal(size=(50, body.model.nv))
    for at in (slice(3, 7), slice(10, 14)):
        qpos[:, at] /= np.linalg.norm(qpos[:, at], axis=1, keepdims=True)
    qpos[:, 8] = rng.uniform(-np.pi, np.pi, 50)
    state = body.observe(qpos, qvel)
    again, speeds = body.place(state)
    np.testing.assert_allclose(body.observe(again, speeds), state, atol=1e-12)
    np.testing.assert_array_equal(speeds, qvel)
    np.testing.assert_allclose(again[:, 7:10], qpos[:, 7:10], atol=1e-12)
    if travel:
        np.testing.assert_array_equal(again[:, :3], qpos[:, :3])
    else:
        np.testing.assert_array_equal(again[:, :2], np.zeros((50, 2)))


def test_what_is_no_orientation_becomes_one(arm: str) -> None:
    """A flow's samples are only near the manifold; even zeros must give a place to draw."""
    body = JointBody(Path(arm))
    state = np.random.default_rng(1).normal(size=(20, len(body.state_names)))
    state[0] = 0.0
    state[1, 4:7] = 2 * state[1, 1:4]  # two columns that are one direction
    qpos, _ = body.place(state)
    assert np.isfinite(qpos).all()
    for at in (slice(3, 7), slice(10, 14)):
        np.testing.assert_allclose(np.linalg.norm(qpos[:, at], axis=1), 1.0, atol=1e-9)
    # The first column's direction is kept.
    columns = body.observe(qpos, np.zeros((20, body.model.nv)))[2:, 1:4]
    wanted = state[2:, 1:4] / np.linalg.norm(state[2:, 1:4], axis=1, keepdims=True)
    np.testing.assert_allclose(columns, wanted, atol=1e-9)


def test_actions_span_what_the_motors_take(arm: str) -> None:
    env = make(arm, 2, 0)
    assert isinstance(env, MujocoVectorEnv)
    env.step(np.array([[-1.0, -1.0], [1.0, 1.0]]))
    np.testing.assert_allclose(env.get_state()["ctrl"], [[-1.0, 0.0], [1.0, 0.5]])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<mujoco>", "does not compile"),
        ("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", "no joint"),
        ("<mujoco><worldbody><geom size='-1'/></worldbody></mujoco>", "does not compile"),
        ("<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>", "motor"),
    ],
)
def test_models_that_cannot_be_used_are_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "bad.xml").write_text(text)
    with pytest.raises(EverystateError, match=f"bad.xml.*{said}"):
        make(str(tmp_path / "bad.xml"), 1, 0)
    with pytest.raises(EverystateError, match="no MJCF file"):
        make(str(tmp_path / "none.xml"), 1, 0)


def test_options_are_checked(arm: str) -> None:
    with pytest.raises(EverystateError, match="frame_skip is -1"):
        make(arm, 1, 0, frame_skip=-1)
    with pytest.raises(EverystateError, match="option travel is 1: expected bool"):
        make(arm, 1, 0, travel=1)
    with pytest.raises(EverystateError, match="no option 'travle': did you mean 'travel'"):
        make(arm, 1, 0, travle=True)


def test_where_an_ant_has_got_to_follows_from_its_velocities():
    """Against MuJoCo's own x and y, which the ant does not observe."""
    seen, unseen = make("ant", 4, 0, travel=True), make("ant", 4, 0)
    assert isinstance(seen, MujocoVectorEnv)
    assert isinstance(unseen, MujocoVectorEnv)
    states = []
    observations, _ = seen.reset(seed=1)
    for actions in np.random.default_rng(0).uniform(-1, 1, (12, 4, 8)).astype(np.float32):
        for _ in range(5):
            states.append(observations)
            observations, *_ = seen.step(actions)
    paths = np.stack(states, axis=1)
    hidden = [i for i, n in enumerate(seen.state_names) if n not in ("torso_x", "torso_y")]
    assert len(unseen.body.unseen) == 1
    assert seen.body.unseen == ()
    for path in paths:
        found = unseen.body.carried(path[:, hidden])
        true = path[:, :2] - path[0, :2]
        assert np.abs(true).max() > 0.1
        np.testing.assert_allclose(found[:, :2], true, atol=0.05 + 0.05 * np.abs(true).max())
        assert np.count_nonzero(found[:, 2:]) == 0


# --- Without the heading ---


def tumbled(arm: str, num: int = 40) -> tuple[JointBody, np.ndarray, np.ndarray]:
    """A body that does not observe its heading, and poses and velocities of every kind."""
    body, rng = JointBody(Path(arm), heading=False), np.random.default_rng(3)
    qpos, qvel = rng.normal(size=(num, body.model.nq)), rng.normal(size=(num, body.model.nv))
    for at in (slice(3, 7), slice(10, 14)):
        qpos[:, at] /= np.linalg.norm(qpos[:, at], axis=1, keepdims=True)
    qpos[:, 8] = rng.uniform(-np.pi, np.pi, num)
    return body, qpos, qvel


def test_a_state_without_heading_is_the_same_whichever_way_it_faces(arm: str) -> None:
    body, qpos, qvel = tumbled(arm)
    assert list(body.state_names) == [
        *("base_z", "base_upx", "base_upy", "base_upz"),
        *POSE[7:],
        *SPEEDS,
    ]
    turned, angle = qpos.copy(), np.random.default_rng(4).uniform(-np.pi, np.pi, len(qpos))
    turn = Rotation.from_rotvec(np.outer(angle, [0.0, 0.0, 1.0]))
    turned[:, :2] = 5.0
    turned[:, 3:7] = (turn * Rotation.from_quat(qpos[:, 3:7], scalar_first=True)).as_quat(
        scalar_first=True
    )
    speeds = np.concatenate([turn.apply(qvel[:, :3]), qvel[:, 3:]], axis=1)
    np.testing.assert_allclose(body.observe(turned, speeds), body.observe(qpos, qvel), atol=1e-12)
    matrices = Rotation.from_quat(qpos[:, 3:7], scalar_first=True).as_matrix()
    state = body.observe(qpos, qvel)
    np.testing.assert_allclose(state[:, 1:4], matrices[:, 2], atol=1e-12)
    column = body.state_names.index("base_vx")
    forward = np.einsum("ni,ni->n", matrices[:, :, 0], qvel[:, :3])
    np.testing.assert_allclose(state[:, column], forward, atol=1e-12)


def test_a_state_without_heading_can_be_put_back(arm: str) -> None:
    body, qpos, qvel = tumbled(arm)
    qpos[0, 3:7] = [0.0, 0.6, 0.8, 0.0]  # upside down
    state = body.observe(qpos, qvel)
    np.testing.assert_allclose(body.observe(*body.place(state)), state, atol=1e-9)
    made_up = np.random.default_rng(1).normal(size=(20, len(body.state_names)))
    made_up[0] = 0.0
    np.testing.assert_allclose(np.linalg.norm(body.place(made_up)[0][:, 3:7], axis=1), 1.0)


def test_where_it_faces_and_has_got_to_follows_from_its_velocities(arm: str) -> None:
    """Against MuJoCo's own, while it flies and turns over."""
    body = JointBody(Path(arm), heading=False, frame_skip=2)
    model, data = body.model, mujoco.MjData(body.model)
    model.opt.gravity[:] = 0.0
    data.qvel[:6] = [0.5, -1.0, 0.2, 2.0, 3.0, 2.5]
    poses, states = [], []
    for _ in range(200):  # 2 s
        poses.append(data.qpos.copy())
        states.append(body.observe(data.qpos[None], data.qvel[None])[0])
        mujoco.mj_step(model, data, 2)
    path, true = np.array(states), np.array(poses)
    assert path[:, 3].min() < -0.5  # it did turn over
    gone = body.carried(path)
    found = body.moved(body.place(path)[0], gone)
    first = body.place(path[:1])[0][0, 3:7] - true[0, 3:7]
    np.testing.assert_allclose(first, 0.0, atol=1e-9)  # it began facing 0
    np.testing.assert_allclose(found[:, :2], true[:, :2], atol=0.03)
    along = np.abs((found[:, 3:7] * true[:, 3:7]).sum(axis=1))
    assert np.degrees(2 * np.arccos(np.minimum(along, 1.0))).max() < 5.0
    turned = body.carried(path, heading=np.pi / 2)
    np.testing.assert_allclose(turned[:, 0], -gone[:, 1], atol=1e-9)
    np.testing.assert_allclose(turned[:, 1], gone[:, 0], atol=1e-9)


def test_options_that_need_a_heading_are_refused(arm: str) -> None:
    with pytest.raises(EverystateError, match="travel=true needs heading=true"):
        make(arm, 1, 0, travel=True, heading=False)
    with pytest.raises(EverystateError, match="leave out heading=false"):
        make("ant", 1, 0, heading=False)
