"""The ant's skills: their geometry against MuJoCo's, and their rules on hand-made trajectories."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from everystate.envs import make
from everystate.envs.ant import Ant
from everystate.skills import ant, ant_rules, skill

FEET = [f"{end}_{side}_foot" for end, side in ant_rules.LEGS]


def still(steps: int, **changes: Any) -> np.ndarray:
    """States [steps, 1, 29] of an ant that stands as `changes` say."""
    return np.tile(ant.state(ant.STANDS, **changes), (steps, 1, 1))


def done(name: str, states: np.ndarray) -> bool:
    (result,) = skill("ant", name).done(states)
    return bool(result)


def played(
    name: str, poses: Callable[[int], np.ndarray | list[float]], gain: float = 1.5
) -> np.ndarray:
    """States of four ants whose joints are held to `poses` by springs and dampers, by MuJoCo."""
    one, env = skill("ant", name), make("ant", 4, 0)
    states = [one.starts(np.random.default_rng(0), 4).astype(np.float32)]
    env.set_observations(states[0])
    for step in range(one.steps):
        now = states[-1].astype(float)
        push = gain * (np.array(poses(step)) - now[:, 7:15]) - 0.15 * now[:, 21:29]
        states.append(env.step(push.clip(-1, 1))[0])
    return np.stack(states)


def test_feet_are_where_mujoco_has_them() -> None:
    body = Ant()
    rng, data = np.random.default_rng(0), mujoco.MjData(body.model)
    states = ant.anyhow(rng, 10)
    states[:, 7:15] += rng.uniform(-0.5, 0.5, (10, 8))
    qpos, _ = body.place(states)
    for joints, heights in zip(qpos, ant_rules.feet(states[None])[0], strict=True):
        data.qpos[:] = joints
        mujoco.mj_kinematics(body.model, data)
        for name, height in zip(FEET, heights, strict=True):
            geom = data.geom(name)
            tip = geom.xpos[2] + abs(geom.xmat[8]) * body.model.geom(name).size[1]
            ends = {tip, 2 * geom.xpos[2] - tip}  # a capsule has two, one of them the tip
            assert min(abs(height + 0.08 - end) for end in ends) < 1e-4


def test_nothing_is_lower_than_the_lowest_of_its_points() -> None:
    body = Ant()
    rng, data = np.random.default_rng(1), mujoco.MjData(body.model)
    states = ant.anyhow(rng, 20)
    states[:, 7:15] += rng.uniform(-0.5, 0.5, (20, 8))
    lowest = np.concatenate(ant_rules.points(states[None]), axis=-1).min(axis=-1)[0]
    for joints, torso, low in zip(body.place(states)[0], states[:, 0], lowest, strict=True):
        data.qpos[:] = joints
        mujoco.mj_kinematics(body.model, data)
        half = np.where(body.model.geom_type == mujoco.mjtGeom.mjGEOM_CAPSULE, 1, 0)
        half = half * np.abs(data.geom_xmat[:, 8]) * body.model.geom_size[:, 1]
        bottoms = data.geom_xpos[:, 2] - half - body.model.geom_size[:, 0]
        touching = (body.model.geom_contype > 0) & (body.model.geom_bodyid > 0)
        assert abs(min(low, torso - ant_rules.TORSO) - bottoms[touching].min()) < 1e-4


def test_spinning_is_three_seconds_at_a_radian_each() -> None:
    def turning(rate: float) -> np.ndarray:
        states = still(201)
        heading = rate * np.arange(201) / 20
        states[:, 0, 1], states[:, 0, 2] = np.cos(heading), np.sin(heading)
        states[:, 0, 4], states[:, 0, 5] = -np.sin(heading), np.cos(heading)
        return states

    assert done("spin-left", turning(1.1))
    assert not done("spin-right", turning(1.1))
    assert not done("spin-left", turning(0.9))
    assert done("spin-right", turning(-1.1))
    assert not done("spin-left", np.concatenate([turning(1.1)[:50], still(150)]))
    lying = turning(1.1)
    lying[..., 0] = ant_rules.TORSO
    assert not done("spin-left", lying)


def test_falling_over_is_no_spin() -> None:
    over = still(201)
    pitch = np.linspace(0, 3.0, 101)
    turned = Rotation.from_euler("zyx", np.stack([0 * pitch + 0.02, pitch, 0 * pitch], axis=1))
    axes = turned.as_matrix()[:, :, :2].transpose(0, 2, 1).reshape(-1, 6)
    over[100:, 0, 1:7] = axes  # its nose goes down and round: half a turn, seen from above
    heading = np.unwrap(np.arctan2(over[:, 0, 2], over[:, 0, 1]))
    assert (heading[60:] - heading[:-60]).max() > 3
    assert not done("spin-left", over)
    assert not done("spin-right", over)


WALKS = [("walk-forward-by-gait", 0), ("walk-sideways-by-gait", 1)]


@pytest.mark.parametrize(("name", "axis"), WALKS)
def test_walking_is_along_an_axis_of_its_own(name: str, axis: int) -> None:
    velocity = 0.6 * np.eye(3)[axis]
    walking = still(100, velocity=tuple(velocity))
    assert done(name, walking)
    assert not done(name, still(100, velocity=tuple(velocity[[1, 0, 2]])))
    assert not done(name, still(100, velocity=tuple(0.7 * velocity)))
    quarter = (0.0, 1.0, 0.0, -1.0, 0.0, 0.0)  # to the left: its x axis along the world's y
    ahead = still(100, axes=quarter, velocity=(0.0, 0.6, 0.0))
    assert done(name, ahead) == (axis == 0)


@pytest.mark.parametrize(("name", "axis"), WALKS)
def test_sliding_on_the_belly_or_the_back_is_no_walk(name: str, axis: int) -> None:
    sliding = still(100, velocity=tuple(0.6 * np.eye(3)[axis]))
    assert done(name, sliding)
    sliding[::20, :, 0] = ant_rules.TORSO  # down once a second
    assert not done(name, sliding)
    own = np.reshape(ant.OVER, (2, 3))[axis]
    assert not done(name, still(100, axes=ant.OVER, velocity=tuple(0.6 * own)))


@pytest.mark.parametrize("name", ["walk-forward-by-gait", "walk-sideways-by-gait"])
def test_walks_say_what_they_are_given(name: str) -> None:
    assert "supplied joint by joint" in skill("ant", name).text
    assert "0.3 rad of its heading" in skill("ant", name).text
    starts = skill("ant", name).starts(np.random.default_rng(0), 1000)
    assert np.abs(np.arctan2(starts[:, 2], starts[:, 1])).max() <= 0.3


@pytest.mark.parametrize("name", ["walk-forward-by-gait", "walk-sideways-by-gait"])
def test_joints_that_follow_the_goals_of_walking_walk(name: str) -> None:
    one = skill("ant", name)
    states = played(name, lambda step: np.array(one.goal(step))[7:15])
    assert one.done(states).all()


def test_the_goals_of_spinning_spin() -> None:
    for name in ("spin-left", "spin-right"):
        one = skill("ant", name)
        goals = np.array([one.goal(step) for step in range(one.steps + 1)])
        assert one.done(goals[:, None]).all()


LOW, TALL, LEVEL = [0.0, 0.6] * 4, [0.0, -0.349] * 4, [0.0, ant_rules.LEVEL] * 4


def test_jumping_rises_with_all_of_it_in_the_air() -> None:
    stand, high = still(50), still(1, velocity=(0.0, 0.0, 0.5))
    high[..., 0] = 1.0
    assert not done("jump", stand)
    assert done("jump", np.concatenate([stand, high]))
    splayed = still(50, ankles=(ant_rules.LEVEL,) * 4, velocity=(0.0, 0.0, 0.5))
    splayed[..., 0] = 0.27  # nor does a torso that lies with its feet in the air
    assert not done("jump", splayed)
    on_edge = still(50, axes=(0.7, 0.0, 0.714, 0.0, 1.0, 0.0), velocity=(0.0, 0.0, 0.5))
    on_edge[..., 7:15] = [0.0, 2 * ant_rules.LEVEL] * 4
    on_edge[..., 0] += 0.01 - ant_rules.points(on_edge)[1].min()  # on its knees
    assert on_edge[0, 0, 0] - ant_rules.TORSO > ant_rules.OFF
    assert not done("jump", on_edge)
    on_edge[..., 0] += 0.1
    assert done("jump", on_edge)


def test_legs_that_are_drawn_in_fall_and_legs_that_push_jump() -> None:
    drawn = played("jump", lambda step: TALL if step < 20 else LEVEL)
    assert (
        ((ant_rules.feet(drawn).min(axis=-1) > ant_rules.OFF) & (drawn[..., 0] > 0.5))
        .any(axis=0)
        .all()
    )
    assert not skill("ant", "jump").done(drawn).any()
    pushed = played("jump", lambda step: LOW if step < 20 else TALL, gain=5.0)
    assert skill("ant", "jump").done(pushed).all()


def test_a_flip_goes_over_and_ends_on_its_feet() -> None:
    up, over = still(50), still(50, axes=ant.OVER)
    assert done("flip", np.concatenate([up, over, up]))
    assert done("flip", np.concatenate([up, over, up[:10]]))
    assert not done("flip", np.concatenate([up, over, up[:9]]))
    assert not done("flip", np.concatenate([up, over]))
    assert not done("flip", np.concatenate([up, over, up, over]))
    assert not done("flip", up)
    side = still(50, axes=(1.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert not done("flip", np.concatenate([up, side, up]))
    belly = still(50, ankles=(ant_rules.LEVEL,) * 4)
    belly[..., 0] = ant_rules.TORSO
    assert not done("flip", np.concatenate([up, over, belly]))
    airborne = still(50)
    airborne[..., 0] += 0.1
    assert not done("flip", np.concatenate([up, over, airborne]))
    for raised in (1, 2):  # three feet will do, two will not
        legs = still(50)
        legs[..., 8 : 8 + 2 * raised : 2] = ant_rules.LEVEL
        assert done("flip", np.concatenate([up, over, legs])) == (raised == 1)


def on_two() -> np.ndarray:
    """Ten steps on its hind feet."""
    tilted = still(10, axes=(np.cos(0.5), 0.0, np.sin(0.5), 0.0, 1.0, 0.0))
    tilted[..., 0] += 0.01 - ant_rules.feet(tilted).min()
    return tilted


def test_two_legs_are_two_for_half_a_second() -> None:
    assert done("two-legs", on_two())
    assert not done("two-legs", on_two()[:9])
    assert not done("two-legs", still(20))
    falling = on_two()
    falling[5, :, 19] = 0.6  # rad/s
    assert not done("two-legs", falling)


def test_two_legs_are_the_same_two() -> None:
    pairs = np.repeat([[0, 2], [1, 3]], 5, axis=0)  # diagonal ones by turns, as in a trot
    trot = still(10)
    for one, pair in zip(trot, pairs, strict=True):
        one[0, 8 + 2 * pair] = ant_rules.LEVEL
    assert ((ant_rules.feet(trot) < ant_rules.OFF).sum(axis=-1) == 2).all()
    assert not done("two-legs", trot)
    assert done("two-legs", np.repeat(trot[:1], 10, axis=0))


def test_kneeling_is_not_standing_on_two_legs() -> None:
    tilt = np.arcsin(0.38) * np.array([1.0, -1.0, 0.0]) / np.sqrt(2)  # back right down
    axes = Rotation.from_rotvec(tilt).as_matrix()[:, :2].T.ravel()
    drop = np.array(
        [0.445, -ant_rules.LEVEL, 0.445]
    )  # of the legs beside, and of the one that kneels
    ankles = (-ant_rules.LEVEL, *drop)
    kneels = still(10, axes=tuple(axes), ankles=tuple(ant_rules.LEVEL - np.array(ankles)))
    kneels[..., 0] += 0.01 - ant_rules.points(kneels)[1].min()
    assert ((ant_rules.feet(kneels) < ant_rules.OFF).sum(axis=-1) == 2).all()
    assert (kneels[..., 0] > 0.3).all()
    assert not done("two-legs", kneels)


def test_feet_up_are_above_all_of_the_torso_for_half_a_second() -> None:
    over = still(10, axes=ant.OVER)
    assert done("feet-up", over)
    assert not done("feet-up", over[:9])
    assert not done("feet-up", still(10, axes=ant.OVER, ankles=(ant_rules.LEVEL,) * 4))
    half = still(10, axes=ant.OVER, ankles=(ant_rules.LEVEL - 0.4,) * 4)  # above its middle
    assert (ant_rules.feet(half) > half[..., :1]).all()
    assert not done("feet-up", half)
    upright = still(10, ankles=(2 * ant_rules.LEVEL,) * 4)
    assert (ant_rules.feet(upright) > upright[..., :1] + ant_rules.TORSO).all()
    assert not done("feet-up", upright)
    assert not done("feet-up", still(10))


def test_feet_go_up_by_its_joints_and_not_by_themselves() -> None:
    assert skill("ant", "feet-up").done(played("feet-up", lambda step: [0.0] * 8)).all()
    idle = played("feet-up", lambda step: LEVEL, gain=0.0)
    assert (ant_rules.up(idle) < -0.95).all()
    assert not skill("ant", "feet-up").done(idle).any()


def test_recovering_ends_on_its_feet_and_still() -> None:
    up, over = still(60), still(60, axes=ant.OVER)
    assert done("recover", np.concatenate([over, up]))
    assert not done("recover", np.concatenate([up, over]))
    assert not done("recover", np.concatenate([over, still(60, turning=(0.0, 0.0, 1.0))]))
    belly = still(60, ankles=(ant_rules.LEVEL,) * 4)
    belly[..., 0] = ant_rules.TORSO
    assert not done("recover", np.concatenate([over, belly]))


def test_who_lies_as_it_fell_has_not_recovered() -> None:
    one, env = skill("ant", "recover"), make("ant", 20, 0)
    env.set_observations(one.starts(np.random.default_rng(0), 20).astype(np.float32))
    states = np.stack([env.step(np.zeros((20, 8)))[0] for _ in range(one.steps)])
    right_way_up = (ant_rules.up(states[-20:]) > 0.7).all(axis=0)
    assert right_way_up.any()
    assert not one.done(states).any()
