"""Cartpole and Ant against the models they come from, and the ant against its mirror image."""

import importlib.resources

import dm_control.suite
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from everystate.envs import Ant, MujocoVectorEnv, make
from everystate.envs.body import load_model

ANKLES = slice(1, 8, 2)
REST = 0.8951023805006386  # where the foot is level: twice the half angle of its frame's quaternion
MIRROR = np.diag([1.0, -1.0, 1.0])  # of the world, in its xz plane
BELLY = np.diag([1.0, 1.0, -1.0])  # of the ant, in its own xy plane


def reference_ant() -> mujoco.MjModel:
    """dm_control's ant with a free joint, a floor, and what makes it symmetric."""
    xml = importlib.resources.files("dm_control") / "third_party/ant/ant.xml"
    spec = mujoco.MjSpec.from_string(xml.read_text())
    spec.option.timestep = 0.005
    spec.body("torso").add_freejoint()
    floor = spec.worldbody.add_geom(spec.default)
    floor.type, floor.size = mujoco.mjtGeom.mjGEOM_PLANE, [0, 0, 1]
    for joint in spec.joints:
        if joint.name.endswith("ankle"):
            joint.range, joint.springref = [-0.34906, 2 * REST + 0.34906], REST
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    return spec.compile()


def reference_cartpole() -> mujoco.MjModel:
    """dm_control's cart-pole."""
    return dm_control.suite.load("cartpole", "swingup").physics.model.ptr


@pytest.mark.parametrize(
    ("body", "reference"), [("cartpole", reference_cartpole), ("ant", reference_ant)]
)
def test_moves_as_the_model_it_comes_from(body: str, reference) -> None:
    theirs, env = reference(), make(body, 1, 0)
    assert isinstance(env, MujocoVectorEnv)
    ours = env.model
    np.testing.assert_allclose(ours.body_mass, theirs.body_mass, rtol=1e-12)
    np.testing.assert_allclose(ours.body_inertia, theirs.body_inertia, rtol=1e-12)
    data = [mujoco.MjData(model) for model in (ours, theirs)]
    rng = np.random.default_rng(0)
    moved = np.zeros(ours.nq)
    for _ in range(40):
        action = rng.uniform(-1, 1, ours.nu)
        for model, one in zip((ours, theirs), data, strict=True):
            one.ctrl[:] = action
            mujoco.mj_step(model, one, nstep=5)
        moved = np.maximum(moved, np.abs(data[0].qpos - ours.qpos0))
        np.testing.assert_allclose(data[0].qpos, data[1].qpos, atol=1e-9)
    assert (moved > 1e-3).all()


def test_an_upside_down_ant_mirrors_an_upright_one() -> None:
    """With negated ankle actions, the whole way through its contacts with the floor."""
    model = load_model(Ant().xml)
    upright, other = mujoco.MjData(model), mujoco.MjData(model)
    upright.qpos[2] = 0.6
    turn = Rotation.from_matrix(MIRROR @ BELLY)
    other.qpos[:7] = [0, 0, 0.6, *turn.as_quat(scalar_first=True)]
    other.qpos[7:] = upright.qpos[7:]
    other.qpos[7:][ANKLES] = 2 * REST - upright.qpos[7:][ANKLES]
    rng = np.random.default_rng(0)
    touched = 0
    for _ in range(40):
        upright.ctrl[:] = other.ctrl[:] = rng.uniform(-1, 1, 8)
        other.ctrl[ANKLES] *= -1
        for data in (upright, other):
            mujoco.mj_step(model, data, nstep=5)
        touched += upright.ncon
        expected = upright.qpos.copy()
        expected[1] *= -1
        mirrored = MIRROR @ upright.body("torso").xmat.reshape(3, 3) @ BELLY
        expected[7:][ANKLES] = 2 * REST - expected[7:][ANKLES]
        np.testing.assert_allclose(other.qpos[:3], expected[:3], atol=1e-12)
        np.testing.assert_allclose(other.qpos[7:], expected[7:], atol=1e-12)
        np.testing.assert_allclose(other.body("torso").xmat.reshape(3, 3), mirrored, atol=1e-12)
    assert touched > 20


def test_no_ant_gets_stuck_in_100_seconds() -> None:
    """Afterwards every one can still bend its legs, turn its torso and go elsewhere."""
    env = make("ant", 16, 0)
    assert isinstance(env, MujocoVectorEnv)
    rng = np.random.default_rng(0)
    assert env.control_step is not None
    for _ in range(round(100 / env.control_step)):
        env.step(rng.uniform(-1, 1, env.action_space.shape))
    places, states = [], []
    for _ in range(round(5 / env.control_step)):
        states.append(env.step(rng.uniform(-1, 1, env.action_space.shape))[0])
        places.append(env.get_state()["qpos"][:, :2])
    moved = np.ptp(np.array(states), axis=0)
    names = env.state_names
    legs = [i for i, name in enumerate(names) if name.endswith(("hip", "ankle"))]
    turns = [i for i, name in enumerate(names) if name.startswith(("torso_x", "torso_y"))]
    assert moved[:, legs].min() > 0.1  # radians
    assert moved[:, turns].max(axis=1).min() > 0.1
    assert np.ptp(np.array(places), axis=0).max(axis=1).min() > 0.05  # metres


def test_cartpole_swings_as_a_pendulum() -> None:
    """Small swings of a rod of length 1 on a cart that hardly moves take about 1.6 s."""
    env = make("cartpole", 1, 0)
    env.set_observations(np.array([[0.0, -np.cos(0.1), np.sin(0.1), 0.0, 0.0]]))
    path = np.array([env.step(np.zeros((1, 1)))[0][0] for _ in range(200)])
    crossings = np.flatnonzero(np.diff(np.sign(path[:, 2])) != 0)
    period = 2 * 0.04 * np.diff(crossings).mean()
    # Rod of mass 0.1 on a cart of mass 1: omega^2 = (m g l/2) / (m l^2/3 - (m l/2)^2 / (M + m)).
    omega = np.sqrt(0.1 * 9.81 * 0.5 / (0.1 / 3 - 0.05**2 / 1.1))
    assert period == pytest.approx(2 * np.pi / omega, rel=0.03)
