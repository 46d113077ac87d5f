"""The ant's skills: their geometry against MuJoCo's, and their rules on hand-made trajectories."""

from typing import Any

import mujoco
import numpy as np
import pytest

from everystate.envs import make
from everystate.envs.ant import Ant
from everystate.skills import ant, skill

FEET = [f"{end}_{side}_foot" for end, side in ant.LEGS]


def still(steps: int, **changes: Any) -> np.ndarray:
    """States [steps, 1, 29] of an ant that stands as `changes` say."""
    return np.tile(ant.state(ant.STANDS, **changes), (steps, 1, 1))


def done(name: str, states: np.ndarray) -> bool:
    (result,) = skill("ant", name).done(states)
    return bool(result)


def test_feet_are_where_mujoco_has_them() -> None:
    body = Ant()
    rng, data = np.random.default_rng(0), mujoco.MjData(body.model)
    states = ant.anyhow(rng, 10)
    states[:, 7:15] += rng.uniform(-0.5, 0.5, (10, 8))
    qpos, _ = body.place(states)
    for joints, heights in zip(qpos, ant.feet(states[None])[0], strict=True):
        data.qpos[:] = joints
        mujoco.mj_kinematics(body.model, data)
        for name, height in zip(FEET, heights, strict=True):
            geom = data.geom(name)
            tip = geom.xpos[2] + abs(geom.xmat[8]) * body.model.geom(name).size[1]
            ends = {tip, 2 * geom.xpos[2] - tip}  # a capsule has two, one of them the tip
            assert min(abs(height + 0.08 - end) for end in ends) < 1e-4


def test_spinning_is_three_seconds_at_a_radian_each() -> None:
    def turning(rate: float) -> np.ndarray:
        states = still(201)
        heading = rate * np.arange(201) / 20
        states[:, 0, 1], states[:, 0, 2] = np.cos(heading), np.sin(heading)
        return states

    assert done("spin-left", turning(1.1))
    assert not done("spin-right", turning(1.1))
    assert not done("spin-left", turning(0.9))
    assert done("spin-right", turning(-1.1))
    assert not done("spin-left", np.concatenate([turning(1.1)[:50], still(150)]))


@pytest.mark.parametrize(("name", "axis"), [("walk-forward", 0), ("walk-sideways", 1)])
def test_walking_is_along_an_axis_of_its_own(name: str, axis: int) -> None:
    velocity = 0.6 * np.eye(3)[axis]
    assert done(name, still(100, velocity=tuple(velocity)))
    assert not done(name, still(100, velocity=tuple(velocity[[1, 0, 2]])))
    assert not done(name, still(100, velocity=tuple(0.7 * velocity)))
    quarter = (0.0, 1.0, 0.0, -1.0, 0.0, 0.0)  # to the left: its x axis along the world's y
    ahead = still(100, axes=quarter, velocity=(0.0, 0.6, 0.0))
    assert done("walk-forward", ahead)
    assert not done("walk-sideways", ahead)


@pytest.mark.parametrize("name", ["walk-forward", "walk-sideways"])
def test_joints_that_follow_the_goals_of_walking_walk(name: str) -> None:
    one, env = skill("ant", name), make("ant", 4, 0)
    states = [one.starts(np.random.default_rng(0), 4).astype(np.float32)]
    env.set_observations(states[0])
    for step in range(one.steps):
        goal, now = np.array(one.goal(step)), states[-1].astype(float)
        push = 1.5 * (goal[7:15] - now[:, 7:15]) - 0.15 * now[:, 21:29]
        states.append(env.step(push.clip(-1, 1))[0])
    assert one.done(np.stack(states)).all()


def test_the_goals_of_spinning_spin() -> None:
    for name in ("spin-left", "spin-right"):
        one = skill("ant", name)
        goals = np.array([one.goal(step) for step in range(one.steps + 1)])
        assert one.done(goals[:, None]).all()


def test_jumping_leaves_the_floor_with_all_four_feet() -> None:
    stand, high = still(50), still(1)
    high[..., 0] = 1.0
    assert not done("jump", stand)
    assert done("jump", np.concatenate([stand, high]))
    splayed = still(50, ankles=(ant.LEVEL,) * 4)
    splayed[..., 0] = 0.3  # nor does a torso that lies with its feet in the air
    assert not done("jump", splayed)


def test_a_flip_goes_over_and_comes_back() -> None:
    up, over = still(50), still(50, axes=ant.OVER)
    assert done("flip", np.concatenate([up, over, up]))
    assert not done("flip", np.concatenate([up, over]))
    assert not done("flip", np.concatenate([over[:0], up]))


def test_two_legs_are_two_for_half_a_second() -> None:
    tilted = still(10, axes=(np.cos(0.5), 0.0, np.sin(0.5), 0.0, 1.0, 0.0))
    tilted[..., 0] += 0.01 - ant.feet(tilted).min()  # its hind feet just above the floor
    assert done("two-legs", tilted)
    assert not done("two-legs", tilted[:9])
    assert not done("two-legs", still(20))


def test_a_headstand_has_all_feet_above_the_torso_for_half_a_second() -> None:
    over = still(10, axes=ant.OVER)
    assert done("headstand", over)
    assert not done("headstand", over[:9])
    assert not done("headstand", still(10, axes=ant.OVER, ankles=(ant.LEVEL,) * 4))
    assert not done("headstand", still(10))


def test_nobody_stands_on_its_head_by_doing_nothing() -> None:
    one, env = skill("ant", "headstand"), make("ant", 4, 0)
    states = [one.starts(np.random.default_rng(0), 4).astype(np.float32)]
    env.set_observations(states[0])
    for _ in range(one.steps):
        states.append(env.step(np.zeros((4, 8)))[0])
    assert (ant.up(np.stack(states)) < -0.95).all()
    assert not one.done(np.stack(states)).any()


def test_recovering_ends_upright_and_still() -> None:
    up, over = still(60), still(60, axes=ant.OVER)
    assert done("recover", np.concatenate([over, up]))
    assert not done("recover", np.concatenate([up, over]))
    assert not done("recover", np.concatenate([over, still(60, turning=(0.0, 0.0, 1.0))]))
