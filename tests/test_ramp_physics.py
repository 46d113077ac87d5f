"""The ramp is a ramp: entered at its foot, lost by falling, walled on two sides."""

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest
from jaxtyping import Float
from scipy.stats import kstest, truncnorm

from everystate.envs import MujocoVectorEnv, RampPointmass, make
from everystate.envs.ramp_pointmass import RADIUS, fell, height, region, set_down
from everystate.errors import EverystateError


def still_env(starts: list[list[float]], **options: float) -> MujocoVectorEnv:
    """Bodies without noise at the given places."""
    env = make("ramp-pointmass", len(starts), 0, **({"noise_sigma": 0.0} | options))
    assert isinstance(env, MujocoVectorEnv)
    env.set_observations(np.array(starts))
    return env


def drive(env: MujocoVectorEnv, action: list[float], steps: int) -> np.ndarray:
    """Where each body is after each step of the same action, with the start in front."""
    actions = np.tile(np.array(action, dtype=np.float32), (env.num_envs, 1))
    places = [env.get_state()["qpos"][:, :2]]
    places += [env.step(actions)[0] for _ in range(steps)]
    return np.stack(places).astype(np.float64)


def test_shape_of_the_world() -> None:
    places = np.array(
        [[0, 0], [0.75, -0.6], [0.75, 0], [0.75, 0.6], [-1, 0.6], [1, 1], [0.49, 0.5]]
    )
    np.testing.assert_allclose(height(places), [0, 0, 0.25, 0.5, 0.5, 0.5, 0])
    expected = ["floor", "floor", "ramp", "ledge", "ledge", "ledge", "floor"]
    assert region(places).tolist() == expected
    assert height(places[2]).shape == ()


def test_helpers_agree_with_the_model() -> None:
    """A ray cast down on the model's solids meets the surface that `height` gives."""
    env = still_env([[0.0, 0.0]])
    data = mujoco.MjData(env.model)
    mujoco.mj_forward(env.model, data)
    mass = env.model.body("mass").id
    groups = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
    geom = np.zeros(1, dtype=np.int32)
    for place in np.random.default_rng(0).uniform(-1, 1, (300, 2)):
        if abs(place[0] - 0.5) < 0.02 and -0.61 < place[1] < -0.29:  # the fence
            continue
        top = np.array([*place, 1.0])
        down = np.array([0.0, 0.0, -1.0])
        distance = mujoco.mj_ray(env.model, data, top, down, groups, 1, mass, geom)
        assert 1.0 - distance == pytest.approx(float(height(place)), abs=1e-6)


@pytest.mark.parametrize("size", [-1.0, -0.3, 0.1, 0.5, 1.0])
def test_free_motion_is_linear_in_the_action(size: float) -> None:
    path = drive(still_env([[0.0, 0.0]]), [size, -size / 2], 3)
    np.testing.assert_allclose(
        np.diff(path[:, 0], axis=0), [[size / 10, -size / 20]] * 3, atol=1e-4
    )


def test_ramp_is_climbed_from_its_foot_to_the_ledge() -> None:
    env = still_env([[0.75, -0.95]])
    path = drive(env, [0.0, 1.0], 22)[:, 0]
    assert list(dict.fromkeys(region(path))) == ["floor", "ramp", "ledge"]
    assert np.diff(height(path)).max() < 0.05
    assert np.diff(path[:, 1])[:15].min() > 0.06  # about as fast as on the floor
    west = drive(env, [-1.0, 0.0], 20)[:, 0]
    assert set(region(west)) == {"ledge"}
    np.testing.assert_allclose(west[-1, 0], -1.0, atol=1e-6)


@dataclass(frozen=True)
class Shoved(RampPointmass):
    """The strongest drive there can be: a full action and the largest noise, the same way."""

    def drive(
        self, actions: Float[np.ndarray, "envs 2"], rng: np.random.Generator
    ) -> Float[np.ndarray, "envs 2"]:
        return actions * (1.0 + self.noise_bound)


def test_neither_ramp_nor_ledge_is_entered_sideways() -> None:
    side = [[0.40, y] for y in np.linspace(-0.59, 0.5, 45)]
    front = [[x, 0.5] for x in np.linspace(-1, 0.4, 30)]
    env = MujocoVectorEnv(Shoved(), len(side + front))
    for push in ([1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.3]):
        env.set_observations(np.array(side + front))
        assert set(region(drive(env, push, 12)).flat) == {"floor"}


def test_fence_keeps_the_foot_of_the_ramp_closed_to_the_west() -> None:
    env = MujocoVectorEnv(Shoved(), 20)
    env.set_observations(np.array([[0.6, y] for y in np.linspace(-0.58, -0.32, 20)]))
    assert drive(env, [-1.0, 0.0], 1)[-1, :, 0].min() > 0.5


def test_falling_west_of_the_ramp_is_over_in_one_step() -> None:
    path = drive(still_env([[0.55, y] for y in np.linspace(-0.25, 0.5, 20)]), [-1.0, 0.0], 1)
    assert fell(path[0], path[1]).all()
    assert set(region(path[1])) == {"floor"}
    assert path[1, :, 0].max() <= 0.5 - RADIUS + 1e-6


def test_falling_south_of_the_ledge_is_over_in_one_step() -> None:
    path = drive(still_env([[x, 0.65] for x in np.linspace(-1, 0.4, 20)]), [0.0, -1.0], 1)
    assert fell(path[0], path[1]).all()
    assert path[1, :, 1].max() <= 0.6 - RADIUS + 1e-6


def test_driving_is_never_counted_as_a_fall() -> None:
    env = MujocoVectorEnv(Shoved(), 1)
    env.set_observations(np.array([[0.75, 0.95]]))
    path = drive(env, [0.0, -1.0], 15)[:, 0]
    assert region(path[-1]) == "floor"
    assert not fell(path[:-1], path[1:]).any()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_walls_hold(axis: int, sign: float) -> None:
    """Pushed for long against a wall, high or low, the mass comes to it and stays inside."""
    env = MujocoVectorEnv(Shoved(), 40)
    starts = np.random.default_rng(1).uniform(-1, 1, (40, 2))
    starts[:20, axis] = sign * 0.98
    env.set_observations(starts)
    push = [0.0, 0.0]
    push[axis] = sign
    path = drive(env, push, 5)
    assert np.abs(path).max() <= 1.0
    np.testing.assert_allclose(path[-1, :20, axis], sign, atol=1e-6)


def test_physics_alone_nearly_ends_where_the_mass_is_set_down() -> None:
    """What is set right after the control step is small: contacts do the work."""
    env = still_env(np.zeros((100, 2)).tolist(), noise_sigma=0.3)
    rng = np.random.default_rng(2)
    moved = []
    for step in range(100):
        if step % 10 == 0:
            env.set_observations(rng.uniform(-1, 1, (100, 2)))
        state = env.get_state()
        state["ctrl"][:] = rng.uniform(-1.6, 1.6, (100, 2))
        data = mujoco.MjData(env.model)
        for i in range(0, 100, 10):
            data.qpos[:], data.qvel[:], data.ctrl[:] = state["qpos"][i], 0.0, state["ctrl"][i]
            mujoco.mj_step(env.model, data, nstep=env.body.frame_skip)
            moved.append(np.abs(set_down(data.qpos[:2]) - data.qpos[:2]).max())
            assert data.qpos[2] > height(set_down(data.qpos[:2])) - 0.02
        env.step(np.zeros((100, 2)))
    assert max(moved) <= RADIUS
    assert np.mean(np.array(moved) > 0.01) < 0.05


def test_height_follows_the_place_through_long_random_play() -> None:
    """And no step climbs faster than driving can: the only way up is the ramp."""
    env = make("ramp-pointmass", 100, 3)
    rng = np.random.default_rng(3)
    env.set_observations(rng.uniform(-1, 1, (100, 2)))
    z = height(env.get_state()["qpos"][:, :2])
    seen, actions = set(), np.zeros((100, 2))
    for step in range(400):
        if step % 10 == 0:
            actions = rng.uniform(-1.5, 1.5, (100, 2)).clip(-1, 1)
        env.step(actions)
        qpos = env.get_state()["qpos"]
        np.testing.assert_array_equal(qpos[:, 2], height(qpos[:, :2]))
        np.testing.assert_array_equal(qpos[:, :2], set_down(qpos[:, :2]))
        assert (qpos[:, 2] - z).max() < 0.07
        z = qpos[:, 2]
        seen |= set(region(qpos[:, :2]))
    assert seen == {"floor", "ramp", "ledge"}


def test_noise_is_a_truncated_normal() -> None:
    noise = RampPointmass().drive(np.zeros((20_000, 2)), np.random.default_rng(0))
    assert np.abs(noise).max() <= 0.6
    assert np.abs(noise).max() > 0.59
    expected = truncnorm(-2, 2, scale=0.3)
    assert kstest(noise.ravel(), expected.cdf).pvalue > 0.01
    assert abs(np.corrcoef(noise.T)[0, 1]) < 0.03


def test_noise_moves_the_mass_by_as_much_as_stated() -> None:
    env = make("ramp-pointmass", 2000, 0)
    env.set_observations(np.zeros((2000, 2)))
    moved = env.step(np.ones((2000, 2)))[0]
    assert moved.min() >= 0.1 * 0.4 - 1e-4
    assert moved.max() <= 0.1 * 1.6 + 1e-4
    assert moved.mean() == pytest.approx(0.1, abs=0.003)
    assert moved.std() == pytest.approx(0.1 * truncnorm(-2, 2, scale=0.3).std(), rel=0.05)


@pytest.mark.parametrize("options", [{"noise_sigma": -0.1}, {"noise_bound": float("nan")}])
def test_impossible_noise_is_refused(options: dict[str, float]) -> None:
    with pytest.raises(EverystateError, match=f"{next(iter(options))} is .*from 0 to 1"):
        make("ramp-pointmass", 1, 0, **options)
