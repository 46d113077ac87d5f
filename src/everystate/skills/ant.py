"""Skills of the ant: its height, the x and y axes of its torso, its joints, and all velocities."""

from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Bool, Float

from everystate.skills.ant_rules import (
    LEVEL,
    SECOND,
    feet_up,
    flips,
    for_three_seconds,
    jumps,
    on_its_feet,
    on_two_legs,
    still,
    upright,
)
from everystate.skills.skill import Rule, Skill, States, held, kept, once

STANDS = 0.52  # m, of its torso above the floor, with ankles at 0
_FACING = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)  # upright, its x axis along the world's
OVER = (1.0, 0.0, 0.0, 0.0, -1.0, 0.0)
_LEVEL = {"pitch": 0.0, "roll": 0.0}
_STILL = {"forward_velocity": 0.0, "sideways_velocity": 0.0, "turning_rate": 0.0}


def state(
    height: float,
    axes: tuple[float, ...] = _FACING,
    ankles: tuple[float, ...] = (0.0,) * 4,
    velocity: tuple[float, ...] = (0.0,) * 3,
    turning: tuple[float, ...] = (0.0,) * 3,
) -> tuple[float, ...]:
    """A state with its hips in the middle and its joints at rest."""
    joints = [angle for ankle in ankles for angle in (0.0, ankle)]
    return (height, *axes, *joints, *velocity, *turning, *(0.0,) * 8)


def _facing(heading: float) -> tuple[float, ...]:
    """Axes upright."""
    cosine, sine = float(np.cos(heading)), float(np.sin(heading))
    return (cosine, sine, 0.0, -sine, cosine, 0.0)


def anyhow(rng: np.random.Generator, num: int) -> Float[np.ndarray, "starts 29"]:
    """Dropped from a height of 0.6 m, in any orientation."""
    states = np.tile(state(0.6, ankles=(LEVEL,) * 4), (num, 1))
    from scipy.spatial.transform import Rotation  # which takes long to import

    turned = Rotation.random(num, rng=rng).as_matrix()
    states[:, 1:7] = np.concatenate([turned[:, :, 0], turned[:, :, 1]], axis=1)
    return states


def _standing(
    rng: np.random.Generator, num: int, within: float = np.pi
) -> Float[np.ndarray, "starts 29"]:
    """On its four feet, facing within so many radians of the world's x axis."""
    states = np.tile(state(STANDS), (num, 1))
    states[:, 1:7] = [_facing(heading) for heading in rng.uniform(-within, within, num)]
    return states


def _lying(rng: np.random.Generator, num: int) -> Float[np.ndarray, "starts 29"]:
    """On its back, facing anywhere, its feet on the floor."""
    states = np.tile(state(0.25, OVER, ankles=(1.2,) * 4), (num, 1))
    for one, heading in zip(states, rng.uniform(-np.pi, np.pi, num), strict=True):
        one[1:7] = np.array(_facing(heading)) * (1, 1, 1, -1, -1, 1)
    return states


def _spin(side: str, way: int) -> Skill:
    """About the vertical; seen from above, to the left is 1, to the right -1.

    After a goal that turns before it, at 1.2 rad/s.
    """
    seconds = np.arange(0, 10, 0.2)
    headings = (way * 1.2 * seconds).tolist()

    def done(states: States) -> Bool[np.ndarray, " starts"]:
        heading = np.unwrap(np.arctan2(states[..., 2], states[..., 1]), axis=0)
        on = upright(states)  # else falling over would turn its x axis round
        turned = way * np.diff(heading, axis=0) * SECOND
        return for_three_seconds(turned, 1.0, on[1:] & on[:-1])

    return Skill(
        text=f"upright, its torso off the floor, turn to the {side}, seen from above,"
        " by 3 rad within 3 of 10 s",
        goals=tuple(state(STANDS, _facing(heading)) for heading in headings),
        steps=10 * SECOND,
        starts=_standing,
        done=done,
    )


def _turn(side: str, way: int) -> Skill:
    """About the vertical, told its turning rate and to stay level, and nothing else."""
    text = (
        f"told a turning rate of 1.2 rad/s to the {side} and to stay level: upright, its torso off"
    )
    return replace(
        _spin(side, way),
        text=f"{text} the floor, turn by 3 rad within 3 of 10 s",
        goals=({"turning_rate": way * 1.2, **_LEVEL},),
    )


def _moves(axis: int) -> Rule:
    """Upright, at half a metre a second along an axis of its torso, over 3 of 10 s."""
    own = slice(1 + 3 * axis, 3 + 3 * axis)  # seen from above

    def done(states: States) -> Bool[np.ndarray, " starts"]:
        speed = (states[..., 15:17] * states[..., own]).sum(axis=-1)
        return for_three_seconds(speed, 0.5, upright(states))

    return done


def _go(way: str, feature: str, axis: int) -> Skill:
    """Along an axis of its torso, told that velocity and to stay level, and nothing else."""
    return Skill(
        text=f"told a velocity of 0.6 m/s {way} and to stay level, from any heading: upright, its"
        " torso off the floor, at 0.5 m/s over 3 of 10 s",
        goals=({feature: 0.6, **_LEVEL},),
        steps=10 * SECOND,
        starts=_standing,
        done=_moves(axis),
    )


def _walk(name: str, axis: int) -> Skill:
    """Along an axis of its torso, by goals that trot before it."""
    steps = 10 * SECOND
    return Skill(
        text=f"follow a trot that is supplied joint by joint along its own {name} axis, from within"
        " 0.3 rad of its heading: upright, its torso off the floor, at 0.5 m/s over 3 of 10 s",
        goals=tuple(_trot(axis, step) for step in range(steps)),
        steps=steps,
        starts=partial(_standing, within=0.3),  # the goals face along x and do not wait
        done=_moves(axis),
    )


def _trot(axis: int, step: int) -> tuple[float, ...]:
    """A goal of a trot along the torso's x or y axis, facing along the world's x."""
    omega = 2 * np.pi * SECOND / 12  # rad/s: 12 steps to a stride
    phase = omega * step / SECOND + np.array([0, np.pi, 0, np.pi])  # diagonal legs together
    ways = (1, -1, -1, 1) if axis == 0 else (-1, -1, 1, 1)  # in which hips swing back
    hips, ankles = 0.48 * np.array(ways), 0.59
    goal = np.array(state(STANDS, velocity=(1.0, 0.0, 0.0) if axis == 0 else (0.0, 1.0, 0.0)))
    goal[7:15:2] = hips * np.sin(phase)
    goal[8:15:2] = ankles * np.sin(phase + 2.8)
    goal[21:29:2] = omega * hips * np.cos(phase)
    goal[22:29:2] = omega * ankles * np.cos(phase + 2.8)
    return tuple(goal.tolist())


SKILLS = {
    "recover": Skill(
        text="dropped in any orientation, be on its feet, its torso off the floor, and nearly still"
        " for the last second of 10",
        goals=(state(STANDS),),
        steps=10 * SECOND,
        starts=anyhow,
        done=kept(lambda states: on_its_feet(states) & still(states), SECOND),
    ),
    "get-up": Skill(
        text="dropped in any orientation and told its height, to be level and to stay where it is:"
        " be on its feet, its torso off the floor, and nearly still for the last second of 10",
        goals=({"height": STANDS, **_LEVEL, **_STILL},),
        steps=10 * SECOND,
        starts=anyhow,
        done=kept(lambda states: on_its_feet(states) & still(states), SECOND),
    ),
    "spin-left": _spin("left", 1),
    "spin-right": _spin("right", -1),
    "turn-left": _turn("left", 1),
    "turn-right": _turn("right", -1),
    "walk-forward": _go("forward", "forward_velocity", 0),
    "walk-sideways": _go("sideways", "sideways_velocity", 1),
    "walk-forward-by-gait": _walk("x", 0),
    "walk-sideways-by-gait": _walk("y", 1),
    "jump": Skill(
        text="rise in the air, with all of its body more than 3 cm off the floor",
        goals=(state(0.3, ankles=(LEVEL,) * 4), state(1.2)) * 4,
        steps=5 * SECOND,
        starts=_standing,
        done=once(jumps),
    ),
    "flip": Skill(
        text="from upright to upside down, and be on its feet, its torso off the floor, for the"
        " last half second of 10 s",
        goals=(state(STANDS, OVER, ankles=(2 * LEVEL,) * 4), state(STANDS)),
        steps=10 * SECOND,
        starts=_standing,
        done=flips,
    ),
    "two-legs": Skill(
        text="stand nearly still on the same two feet, all else off the floor, for half a second",
        goals=(state(0.6, (0.7, 0.0, 0.71, 0.0, 1.0, 0.0)),),
        steps=10 * SECOND,
        starts=_standing,
        done=on_two_legs,
    ),
    "feet-up": Skill(
        text="on its back, raise all feet above all of its torso for half a second",
        goals=(state(0.25, OVER),),
        steps=5 * SECOND,
        starts=_lying,
        done=held(feet_up, SECOND // 2),
    ),
}
