"""Skills of the ant: its height, the x and y axes of its torso, its joints, and all velocities."""

from functools import partial
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from everystate.skills.skill import At, Skill, States, held, kept, once

_SECOND = 20  # control steps
LEVEL = 0.8951  # rad, of an ankle when its foot is level; less is further down
STANDS = 0.52  # m, of its torso above the floor, with ankles at 0
_FACING = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)  # upright, its x axis along the world's
OVER = (1.0, 0.0, 0.0, 0.0, -1.0, 0.0)
_RADIUS = 0.08  # m, of its legs and feet
TORSO = 0.25  # m, its radius
OFF = 0.03  # m above the floor, beyond which a part of it counts as off it
HALF = _SECOND // 2
LEGS = (("front", "left"), ("front", "right"), ("back", "right"), ("back", "left"))


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


# --- What rules look at ---


def up(states: Float[np.ndarray, "*n 29"]) -> Float[np.ndarray, "*n"]:
    """Height of the torso's own z axis: 1 upright, -1 upside down."""
    xx, xy, _, yx, yy, _ = np.moveaxis(states[..., 1:7], -1, 0)
    return xx * yy - xy * yx


def points(states: States) -> tuple[Float[np.ndarray, "steps starts 4"], ...]:
    """Heights above the floor of what of a leg can touch it: hip, knee, and the foot's tip.

    By the legs' geometry in `ant.xml`: nothing of a leg is lower than the lowest of the three.
    """
    x, y = states[..., None, 1:4], states[..., None, 4:7]
    z = np.cross(x, y)
    hips, ankles = states[..., 7:15:2], states[..., 8:15:2]
    ways = np.pi / 4 + np.array([0, -1, -2, 1]) * np.pi / 2  # where the legs stand out to
    drop = LEVEL - ankles  # rad below the leg's own plane
    leg, foot = 0.2 * np.sqrt(2), 0.4 * np.sqrt(2)
    middle = states[..., :1] - _RADIUS

    def out(way: np.ndarray, length: float | np.ndarray) -> np.ndarray:
        return length * (np.cos(way) * x[..., 2] + np.sin(way) * y[..., 2])

    hip = middle + out(ways, leg)
    knee = hip + out(ways + hips, leg)
    tip = knee + out(ways + hips, foot * np.cos(drop)) - foot * np.sin(drop) * z[..., 2]
    return hip, knee, tip


def feet(states: States) -> Float[np.ndarray, "steps starts 4"]:
    """Heights of the tips of the feet above the floor."""
    return points(states)[2]


def _clear(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Its torso, a ball, is off the floor."""
    return states[..., 0] > TORSO + OFF


def _upright(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Within 45 degrees of upright, its torso off the floor."""
    return (up(states) > 0.7) & _clear(states)


def _on_its_feet(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Upright, with three feet or all four down: fewer do not stand."""
    return _upright(states) & ((feet(states) < OFF).sum(axis=-1) >= 3)


def _still(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Its torso moves by less than 0.5 m/s and turns by less than 0.5 rad/s about every axis."""
    return np.abs(states[..., 15:21]).max(axis=-1) < 0.5


def _jumps(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Nothing of it touches, and it rises: legs drawn in from under it leave it to fall."""
    legs = np.concatenate(points(states), axis=-1).min(axis=-1) > OFF
    return legs & _clear(states) & (states[..., 17] > 0)


def _on(pair: tuple[int, int]) -> At:
    """These two feet are down, and nothing else of it touches."""

    def at(states: States) -> Bool[np.ndarray, "steps starts"]:
        hip, knee, tip = points(states)
        off = _clear(states) & (np.minimum(hip, knee).min(axis=-1) > OFF)
        down = tip < OFF
        return off & down[..., pair].all(axis=-1) & (down.sum(axis=-1) == 2)

    return at


def _on_two_legs(states: States) -> Bool[np.ndarray, " starts"]:
    """On the same two for half a second: a trot puts down one pair after the other."""
    pairs = combinations(range(4), 2)
    return np.any([held(_on(pair), HALF)(states) for pair in pairs], axis=0)


def _feet_up(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Upside down, with all feet higher than all of its torso."""
    return (up(states) < -0.7) & (feet(states).min(axis=-1) > states[..., 0] + TORSO)


def _flips(states: States) -> Bool[np.ndarray, " starts"]:
    """Upside down at some time, and on its feet in the end."""
    return once(lambda states: up(states) < -0.7)(states) & kept(_on_its_feet, HALF)(states)


def _for_three_seconds(
    rate: Float[np.ndarray, "steps starts"], least: float, at: Bool[np.ndarray, "steps starts"]
) -> Bool[np.ndarray, " starts"]:
    """Whether over any 3 s the mean is at least so much and something holds all the while."""
    window = 3 * _SECOND
    enough = sliding_window_view(rate, window, axis=0).mean(axis=-1) >= least
    return (enough & sliding_window_view(at, window, axis=0).all(axis=-1)).any(axis=0)


def _spin(side: str, way: int) -> Skill:
    """About the vertical; seen from above, to the left is 1, to the right -1.

    After a goal that turns before it, at 1.2 rad/s.
    """
    seconds = np.arange(0, 10, 0.2)
    headings = (way * 1.2 * seconds).tolist()

    def done(states: States) -> Bool[np.ndarray, " starts"]:
        heading = np.unwrap(np.arctan2(states[..., 2], states[..., 1]), axis=0)
        upright = _upright(states)  # else falling over would turn its x axis round
        turned = way * np.diff(heading, axis=0) * _SECOND
        return _for_three_seconds(turned, 1.0, upright[1:] & upright[:-1])

    return Skill(
        text=f"upright, its torso off the floor, turn to the {side}, seen from above,"
        " by 3 rad within 3 of 10 s",
        goals=tuple(state(STANDS, _facing(heading)) for heading in headings),
        steps=10 * _SECOND,
        starts=_standing,
        done=done,
    )


def _walk(name: str, axis: int) -> Skill:
    """Along an axis of its torso, by goals that trot before it."""
    own = slice(1 + 3 * axis, 3 + 3 * axis)  # seen from above
    steps = 10 * _SECOND

    def done(states: States) -> Bool[np.ndarray, " starts"]:
        speed = (states[..., 15:17] * states[..., own]).sum(axis=-1)
        return _for_three_seconds(speed, 0.5, _upright(states))

    return Skill(
        text=f"follow a trot that is supplied joint by joint along its own {name} axis, from within"
        " 0.3 rad of its heading: upright, its torso off the floor, at 0.5 m/s over 3 of 10 s",
        goals=tuple(_trot(axis, step) for step in range(steps)),
        steps=steps,
        starts=partial(_standing, within=0.3),  # the goals face along x and do not wait
        done=done,
    )


def _trot(axis: int, step: int) -> tuple[float, ...]:
    """A goal of a trot along the torso's x or y axis, facing along the world's x."""
    omega = 2 * np.pi * _SECOND / 12  # rad/s: 12 steps to a stride
    phase = omega * step / _SECOND + np.array([0, np.pi, 0, np.pi])  # diagonal legs together
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
        text="dropped in any orientation, be on its feet, its torso off the floor, and still for"
        " the last second of 10",
        goals=(state(STANDS),),
        steps=10 * _SECOND,
        starts=anyhow,
        done=kept(lambda states: _on_its_feet(states) & _still(states), _SECOND),
    ),
    "spin-left": _spin("left", 1),
    "spin-right": _spin("right", -1),
    "walk-forward-by-gait": _walk("x", 0),
    "walk-sideways-by-gait": _walk("y", 1),
    "jump": Skill(
        text="rise with all of its body more than 3 cm off the floor",
        goals=(state(0.3, ankles=(LEVEL,) * 4), state(1.2)) * 4,
        steps=5 * _SECOND,
        starts=_standing,
        done=once(_jumps),
    ),
    "flip": Skill(
        text="from upright to upside down, and be on its feet, its torso off the floor, for the"
        " last half second of 10 s",
        goals=(state(STANDS, OVER, ankles=(2 * LEVEL,) * 4), state(STANDS)),
        steps=10 * _SECOND,
        starts=_standing,
        done=_flips,
    ),
    "two-legs": Skill(
        text="touch the floor with the same two feet and nothing else for half a second",
        goals=(state(0.6, (0.7, 0.0, 0.71, 0.0, 1.0, 0.0)),),
        steps=10 * _SECOND,
        starts=_standing,
        done=_on_two_legs,
    ),
    "feet-up": Skill(
        text="on its back, raise all feet above all of its torso for half a second",
        goals=(state(0.25, OVER),),
        steps=5 * _SECOND,
        starts=_lying,
        done=held(_feet_up, HALF),
    ),
}
