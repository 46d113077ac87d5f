"""The batched stepper over every body: exact, seeded, nothing shared, drawn and registered."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import imageio.v3 as imageio
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import everystate.envs
from everystate.envs import BODIES, BodyVectorEnv, MujocoVectorEnv, describe, make
from everystate.envs.gymnasium_vector import GymnasiumVectorEnv
from everystate.envs.registered import SingleEnv
from everystate.errors import EverystateError

OTHERS = (
    str(Path(everystate.envs.__file__).with_name("ant.xml")),
    "gymnasium:Pendulum-v1",
    "gymnasium:Ant-v5",
    "shimmy:dm_control/cartpole-balance-v0",
    "gymnasium_robotics:PointMaze_UMaze-v3",
)


@pytest.fixture(params=BODIES)
def ours(request: pytest.FixtureRequest) -> str:
    """Every body of ours in turn."""
    return request.param


@pytest.fixture(params=BODIES + OTHERS, ids=lambda body: Path(body).name)
def body(request: pytest.FixtureRequest) -> str:
    """Every body of ours, and one of each kind there is."""
    return request.param


def play(env: BodyVectorEnv, steps: int, seed: int = 0) -> np.ndarray:
    """Observations under random actions that are the same for the same seed."""
    rng = np.random.default_rng(seed)
    shape = env.action_space.shape
    return np.stack([env.step(rng.uniform(-1, 1, shape))[0] for _ in range(steps)])


def test_spaces_and_names_agree(body: str) -> None:
    env = make(body, 3, 0)
    size = env.single_observation_space.shape
    assert size == (len(env.state_names),) == (len(env.state_units),)
    assert env.scaling.centre.shape == env.scaling.spread.shape == size
    assert (env.scaling.spread > 0).all()
    assert np.isfinite(env.scaling.centre).all()
    observations, reward, terminated, truncated, info = env.step(env.action_space.sample())
    assert observations.dtype == np.float32
    assert env.observation_space.contains(observations)
    assert not any(signal.any() for signal in (reward, terminated, truncated))
    assert info == {}
    assert env.regions(observations).shape == env.falls(observations, observations).shape == (3,)
    assert env.scored(observations).shape[0] == 3
    assert len(env.action_names) == env.single_action_space.shape[0]
    assert [len(bounds) for bounds in env.action_bounds] == [len(env.action_names)] * 2
    for text in (env.name, *env.state_names, *env.action_names):
        assert text in describe(env)


def test_same_seed_same_trajectory(body: str) -> None:
    first, same, other = (play(make(body, 5, seed), 30) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first, same)
    assert (first != other).any()
    assert np.isfinite(first).all()


def test_no_component_is_constant_unless_declared(body: str) -> None:
    env = make(body, 5, 1)
    assert (play(env, 400).std(axis=(0, 1)) > 0)[~env.scaling.constant].all()


def test_reset_with_a_seed_starts_over(body: str) -> None:
    env = make(body, 4, 3)
    start, path = env.reset(seed=3)[0], play(env, 10)
    assert (env.reset()[0] != start).any()
    np.testing.assert_array_equal(env.reset(seed=3)[0], start)
    np.testing.assert_array_equal(play(env, 10), path)


def test_threads_do_not_change_the_physics(ours: str) -> None:
    one, four = (play(make(ours, 40, 0, num_threads=n), 30) for n in (1, 4))
    np.testing.assert_array_equal(one, four)


def test_bodies_step_as_mujoco_steps_one(ours: str) -> None:
    """The first control step equals a loop of mj_step, as long as nothing is left to finish."""
    env = make(ours, 1, 0)
    assert isinstance(env, MujocoVectorEnv)
    state = env.get_state()
    data = mujoco.MjData(env.model)
    data.qpos[:], data.qvel[:] = state["qpos"][0], state["qvel"][0]
    observations = env.step(np.full((1, env.model.nu), 0.5))[0]
    data.ctrl[:] = env.get_state()["ctrl"][0]
    mujoco.mj_step(env.model, data, nstep=env.body.frame_skip)
    expected = env.body.observe(data.qpos[None].copy(), data.qvel[None].copy())
    np.testing.assert_array_equal(observations, expected.astype(np.float32))


def test_snapshot_replays_bit_for_bit(body: str) -> None:
    env = make(body, 6, 1)
    play(env, 20)
    assert env.exact_restore
    saved = env.get_state()
    assert all(type(value) is np.ndarray and value.dtype != object for value in saved.values())
    path, end = play(env, 40, seed=5), env.get_state()
    restored = make(body, 6, 99)
    restored.set_state(saved)
    np.testing.assert_array_equal(play(restored, 40, seed=5), path)
    for name, value in restored.get_state().items():
        np.testing.assert_array_equal(value, end[name])


def test_bodies_go_on_alike_from_the_same_physics(body: str) -> None:
    """One by one, in any order, and whatever they did before."""
    env, other = make(body, 3, 0), make(body, 3, 1)
    play(env, 7)
    taken = json.loads(json.dumps(env.get_physics()))
    seen = env.observe()
    env.set_physics(taken)
    np.testing.assert_array_equal(env.observe(), seen)
    play(other, 4)
    other.set_physics(taken[::-1])
    np.testing.assert_array_equal(other.observe(), seen[::-1])
    if body != "ramp-pointmass":  # whose noise is each copy's own
        actions = np.tile(env.action_space.sample()[:1], (3, 1))
        for _ in range(3):
            np.testing.assert_array_equal(env.step(actions)[0], other.step(actions)[0][::-1])
    for wrong in (taken[:2], [{}] * 3):
        with pytest.raises(EverystateError, match="physics"):
            env.set_physics(wrong)


def test_some_bodies_are_put_back_while_the_others_go_on(body: str) -> None:
    env, unmoved = make(body, 3, 0), make(body, 3, 0)
    taken, seen = env.get_physics(), env.observe()
    actions = np.tile(env.action_space.sample()[:1], (3, 1))
    for one in (env, unmoved):
        one.step(actions)
    second = np.array([False, True, False])
    env.set_physics([taken[2]], second)
    np.testing.assert_array_equal(env.observe()[1], seen[2])
    np.testing.assert_array_equal(env.step(actions)[0][~second], unmoved.step(actions)[0][~second])
    with pytest.raises(EverystateError, match="physics"):
        env.set_physics(taken, second)


def test_snapshot_of_something_else_is_refused(body: str) -> None:
    with pytest.raises(EverystateError, match=f"the state does not belong to 2 x .*{body[-4:]}"):
        make(body, 2, 0).set_state(make(body, 3, 0).get_state())


def test_nothing_is_shared(body: str) -> None:
    env = make(body, 3, 0)
    twin = make(body, 3, 0)
    actions = env.action_space.sample()
    kept = actions.copy()
    results = [env.reset(seed=0)[0], *env.step(actions)[:4], *env.step(actions)[:4]]
    results += [*env.get_state().values(), *env.get_state().values()]
    results += [env.scored(results[0])]
    for i, first in enumerate(results):
        assert not any(np.shares_memory(first, second) for second in results[i + 1 :])
        first[...] = 1
    np.testing.assert_array_equal(actions, kept)
    twin.reset(seed=0)
    for _ in range(2):
        twin.step(actions)
    np.testing.assert_array_equal(play(env, 5), play(twin, 5))


def test_states_are_put_where_asked(ours: str) -> None:
    env = make(ours, 4, 0)
    wanted = play(env, 25)[-1]
    other = make(ours, 4, 9)
    assert isinstance(other, MujocoVectorEnv)
    other.set_observations(wanted)
    state = other.get_state()
    np.testing.assert_allclose(other.body.observe(state["qpos"], state["qvel"]), wanted, atol=1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf, 2.0])
def test_non_finite_actions_are_named(body: str, value: float) -> None:
    env = make(body, 3, 0)
    actions = np.zeros(env.action_space.shape, dtype=np.float32)
    actions[2, -1] = value
    before = env.get_state()
    with pytest.raises(EverystateError, match=f"action of environment 2 is {value} in component"):
        env.step(actions)
    for name, array in env.get_state().items():
        np.testing.assert_array_equal(array, before[name])


def test_non_finite_bodies_are_named(
    ours: str, tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(str(tmp_path))  # MuJoCo writes its log where it stands
    env = make(ours, 3, 0)
    state = env.get_state()
    state["qpos"][1, 0] = np.nan
    env.set_state(state)
    with pytest.raises(EverystateError, match=r"observation of environment 1 is nan in \w+"):
        env.step(np.zeros(env.action_space.shape))


def test_user_errors_name_the_value() -> None:
    with pytest.raises(
        EverystateError, match="unknown body 'ramp-pointmas': did you mean 'ramp-po"
    ):
        make("ramp-pointmas", 1, 0)
    with pytest.raises(EverystateError, match="no option 'noise_sigm': did you mean 'noise_sigma'"):
        make("ramp-pointmass", 1, 0, noise_sigm=0.1)
    with pytest.raises(EverystateError, match="num_envs is 0"):
        make("ramp-pointmass", 0, 0)
    with pytest.raises(EverystateError, match="seed is -1"):
        make("ramp-pointmass", 1, -1)
    with pytest.raises(EverystateError, match=r"actions have shape \(2, 2\): expected \(1, 2\)"):
        make("ramp-pointmass", 1, 0).step(np.zeros((2, 2)))


@pytest.mark.filterwarnings("ignore:.*Box observation space .* value is -?infinity")
def test_gymnasiums_own_checker_passes(body: str) -> None:
    check_env(SingleEnv(body), skip_render_check=True)


def test_an_angle_that_winds_up_is_seen_as_cosine_and_sine() -> None:
    env = make("gymnasium:Hopper-v5", 2, 0)
    assert env.state_names[:4] == (
        *("observation_0", "cos_observation_1", "sin_observation_1", "observation_2"),
    )
    assert "cos_observation_2" not in env.state_names  # a hinge with limits
    assert isinstance(env, GymnasiumVectorEnv)
    for single, turns in zip(env.envs, (0, 1), strict=True):
        bodies: Any = single.unwrapped
        bodies.set_state(np.array([0, 1.2, 0.3 + 2 * np.pi * turns, 0, 0, 0]), np.zeros(6))
    states = env.step(np.zeros((2, 3)))[0]
    np.testing.assert_allclose(states[0], states[1], atol=1e-5)
    np.testing.assert_allclose(states[:, 1:3], [[np.cos(0.3), np.sin(0.3)]] * 2, atol=0.02)
    assert env.single_observation_space.high[1] == 1.0


def test_no_body_is_reset_in_10_000_steps(body: str) -> None:
    """Nor is any ever lost: all stay finite."""
    env = make(body, 10, 0)
    rng = np.random.default_rng(0)
    for _ in range(1000):
        _, _, terminated, truncated, info = env.step(rng.uniform(-1, 1, env.action_space.shape))
        assert not terminated.any()
        assert not truncated.any()
        assert not info


def test_every_body_is_drawn(body: str, tmp_path: Path) -> None:
    env = make(body, 1, 0, render_mode="rgb_array")
    play(env, 5)
    frames = env.render()
    assert frames is not None
    imageio.imwrite(tmp_path / "body.png", frames[0])
    picture = imageio.imread(tmp_path / "body.png")
    assert picture.ndim == 3
    assert picture.std() > 5
    env.close()


def test_gymnasium_finds_ours() -> None:
    env = gymnasium.make("everystate/RampPointmass-v0", render_mode="rgb_array")
    observation, _ = env.reset(seed=5)
    vector = gymnasium.make_vec(
        "everystate/RampPointmass-v0", num_envs=4, vectorization_mode="vector_entry_point"
    )
    assert isinstance(vector, MujocoVectorEnv)
    observations, _ = vector.reset(seed=5)
    assert observations.shape == (4, 2)
    assert env.observation_space.contains(observation)
    unseeded = [gymnasium.make("everystate/RampPointmass-v0").reset()[0] for _ in range(2)]
    assert (unseeded[0] != unseeded[1]).any()


def near(picture: np.ndarray, colour: str) -> np.ndarray:
    """Which pixels are mostly red (the agent) or mostly green (the goal)."""
    red, green, blue = (picture[..., i].astype(int) for i in range(3))
    return {
        "red": (red > 120) & (green < red // 3) & (blue < red // 3),
        "green": (green > red + 50) & (green > blue + 25),
    }[colour]


def test_agent_and_goal_are_both_seen() -> None:
    env = make("ramp-pointmass", 1, 0)
    places = np.array(
        [[-0.5, -0.5], [0.75, 0.0], [-0.5, 0.8], [0.4, 0.5], [0.5, -0.95], [0.95, -0.95]]
    )
    pictures = env.render_states(places, goal=np.array([0.0, 0.8]))
    assert pictures.shape == (6, 240, 320, 3)
    assert pictures.dtype == np.uint8
    for picture in pictures:
        assert near(picture, "red").sum() > 15
        assert near(picture, "green").sum() > 40
    centres = [np.argwhere(near(picture, "red")).mean(axis=0) for picture in pictures]
    assert len({tuple(c.round()) for c in centres}) == len(places)
    assert near(env.render_states(places[:1])[0], "green").sum() == 0


def test_drawing_does_not_disturb_the_run() -> None:
    env, twin = make("ramp-pointmass", 2, 0, render_mode="rgb_array"), make("ramp-pointmass", 2, 0)
    frames = env.render()
    assert frames is not None
    assert np.shape(frames[0]) == (240, 320, 3)
    np.testing.assert_array_equal(play(env, 5), play(twin, 5))
    with pytest.raises(EverystateError, match="picture size 99999 x 240"):
        env.render_states(np.zeros((1, 2)), width=99999)


def test_missing_screen_libraries_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object, **__: object) -> None:
        raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr(mujoco, "Renderer", missing)
    with pytest.raises(EverystateError, match="libegl1 libgl1-mesa-dri"):
        make("ramp-pointmass", 1, 0).render_states(np.zeros((1, 2)))
