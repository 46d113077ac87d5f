"""Skills of the ant: its height, the x and y axes of its torso, its joints, and all velocities."""

from functools import partial

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from everystate.skills.skill import Skill, States, held, kept, once

_SECOND = 20  # control steps
LEVEL = 0.8951  # rad, of an ankle when its foot is level; less is further down
STANDS = 0.52  # m, of its torso above the floor, with ankles at 0
_FACING = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)  # upright, its x axis along the world's
OVER = (1.0, 0.0, 0.0, 0.0, -1.0, 0.0)
_RADIUS = 0.08  # m, of its feet
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


def feet(states: States) -> Float[np.ndarray, "steps starts 4"]:
    """Heights of the tips of the feet above the floor, by the legs' geometry in `ant.xml`."""
    x, y = states[..., None, 1:4], states[..., None, 4:7]
    z = np.cross(x, y)
    hips, ankles = states[..., 7:15:2], states[..., 8:15:2]
    ways = np.pi / 4 + np.array([0, -1, -2, 1]) * np.pi / 2  # where the legs stand out to
    drop = LEVEL - ankles  # rad below the leg's own plane
    leg, foot = 0.2 * np.sqrt(2), 0.4 * np.sqrt(2)
    swung = ways + hips
    out = leg + foot * np.cos(drop)
    across = leg * np.cos(ways) + out * np.cos(swung), leg * np.sin(ways) + out * np.sin(swung)
    tip = across[0] * x[..., 2] + across[1] * y[..., 2] - foot * np.sin(drop) * z[..., 2]
    return states[..., :1] + tip - _RADIUS


def _airborne(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Nothing of it within 3 cm of the floor."""
    return (feet(states).min(axis=-1) > 0.03) & (states[..., 0] > 0.5)


def _on_two_legs(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Just two of its feet near the floor, and its torso off it."""
    down = (feet(states) < 0.03).sum(axis=-1)
    return (down == 2) & (states[..., 0] > 0.3)


def _on_its_head(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Upside down, with all feet higher than its torso."""
    return (up(states) < -0.7) & (feet(states).min(axis=-1) > states[..., 0])


def _over_three_seconds(rate: np.ndarray, least: float) -> Bool[np.ndarray, " starts"]:
    """Whether the mean over any 3 s is at least so much."""
    total = np.concatenate([np.zeros((1, rate.shape[1])), rate.cumsum(axis=0)])
    window = 3 * _SECOND
    return np.asarray(((total[window:] - total[:-window]) / window >= least).any(axis=0))


def _spin(side: str, way: int) -> Skill:
    """About the vertical; seen from above, to the left is 1, to the right -1.

    After a goal that turns before it, at 1.2 rad/s.
    """
    seconds = np.arange(0, 10, 0.2)
    headings = (way * 1.2 * seconds).tolist()

    def done(states: States) -> Bool[np.ndarray, " starts"]:
        heading = np.unwrap(np.arctan2(states[..., 2], states[..., 1]), axis=0)
        return _over_three_seconds(way * np.diff(heading, axis=0) * _SECOND, 1.0)

    return Skill(
        text=f"turn to the {side}, seen from above, by 1 rad/s for 3 of 10 s",
        goals=tuple(state(STANDS, _facing(heading)) for heading in headings),
        steps=10 * _SECOND,
        starts=_standing,
        done=done,
    )


def _walk(name: str, axis: int) -> Skill:
    """Along an axis of its torso, by goals that trot before it."""
    own = slice(1 + 3 * axis, 4 + 3 * axis)
    steps = 10 * _SECOND
    return Skill(
        text=f"go along its own {name} axis at 0.5 m/s for 3 of 10 s",
        goals=tuple(_trot(axis, step) for step in range(steps)),
        steps=steps,
        starts=partial(_standing, within=0.3),  # the goals face along x and do not wait
        done=lambda states: _over_three_seconds(
            (states[..., 15:18] * states[..., own]).sum(-1), 0.5
        ),
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


def _flips(states: States) -> Bool[np.ndarray, " starts"]:
    """Upside down at some time, and upright at a later one."""
    over = np.maximum.accumulate(up(states) < -0.7, axis=0)
    return np.asarray((over & (up(states) > 0.7)).any(axis=0))


SKILLS = {
    "recover": Skill(
        text="dropped in any orientation, be upright and still for the last second of 10",
        goals=(state(STANDS),),
        steps=10 * _SECOND,
        starts=anyhow,
        done=kept(
            lambda states: (up(states) > 0.7) & (np.abs(states[..., 15:21]).max(axis=-1) < 0.5),
            _SECOND,
        ),
    ),
    "spin-left": _spin("left", 1),
    "spin-right": _spin("right", -1),
    "walk-forward": _walk("x", 0),
    "walk-sideways": _walk("y", 1),
    "jump": Skill(
        text="leave the floor with all of its body",
        goals=(state(0.3, ankles=(LEVEL,) * 4), state(1.2)) * 4,
        steps=5 * _SECOND,
        starts=_standing,
        done=once(_airborne),
    ),
    "flip": Skill(
        text="from upright to upside down and back, within 10 s",
        goals=(state(STANDS, OVER, ankles=(2 * LEVEL,) * 4), state(STANDS)),
        steps=10 * _SECOND,
        starts=_standing,
        done=_flips,
    ),
    "two-legs": Skill(
        text="stand on two legs, its torso off the floor, for half a second",
        goals=(state(0.6, (0.7, 0.0, 0.71, 0.0, 1.0, 0.0)),),
        steps=10 * _SECOND,
        starts=_standing,
        done=held(_on_two_legs, _SECOND // 2),
    ),
    "headstand": Skill(
        text="on its back, raise all feet above its torso for half a second",
        goals=(state(0.25, OVER),),
        steps=5 * _SECOND,
        starts=_lying,
        done=held(_on_its_head, _SECOND // 2),
    ),
}
