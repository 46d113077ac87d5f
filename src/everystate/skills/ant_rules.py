"""What the rules of the ant's skills look at: what of it touches the floor, and how it moves."""

from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view

from everystate.skills.skill import At, States, held, kept, once

SECOND = 20  # control steps
LEVEL = 0.8951  # rad, of an ankle when its foot is level; less is further down
LEGS = (("front", "left"), ("front", "right"), ("back", "right"), ("back", "left"))
TORSO, RADIUS = 0.25, 0.08  # m, of its torso, and of its legs and feet
OFF = 0.03  # m above the floor, beyond which a part of it counts as off it


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
    middle = states[..., :1] - RADIUS

    def out(way: np.ndarray, length: float | np.ndarray) -> np.ndarray:
        return length * (np.cos(way) * x[..., 2] + np.sin(way) * y[..., 2])

    hip = middle + out(ways, leg)
    knee = hip + out(ways + hips, leg)
    tip = knee + out(ways + hips, foot * np.cos(drop)) - foot * np.sin(drop) * z[..., 2]
    return hip, knee, tip


def feet(states: States) -> Float[np.ndarray, "steps starts 4"]:
    """Heights of the tips of the feet above the floor."""
    return points(states)[2]


def clear(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Its torso, a ball, is off the floor."""
    return states[..., 0] > TORSO + OFF


def upright(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Within 45 degrees of upright, its torso off the floor."""
    return (up(states) > 0.7) & clear(states)


def on_its_feet(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Upright, with three feet or all four down: fewer do not stand."""
    return upright(states) & ((feet(states) < OFF).sum(axis=-1) >= 3)


def still(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Its torso moves by less than 0.5 m/s and turns by less than 0.5 rad/s about every axis."""
    return np.abs(states[..., 15:21]).max(axis=-1) < 0.5


def jumps(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Nothing of it touches, and it rises: legs drawn in from under it leave it to fall."""
    legs = np.concatenate(points(states), axis=-1).min(axis=-1) > OFF
    return legs & clear(states) & (states[..., 17] > 0)


def _on(pair: tuple[int, int]) -> At:
    """Nearly still, these two feet are down, and nothing else of it touches."""

    def at(states: States) -> Bool[np.ndarray, "steps starts"]:
        hip, knee, tip = points(states)
        off = clear(states) & (np.minimum(hip, knee).min(axis=-1) > OFF)
        down = tip < OFF
        return still(states) & off & down[..., pair].all(axis=-1) & (down.sum(axis=-1) == 2)

    return at


def on_two_legs(states: States) -> Bool[np.ndarray, " starts"]:
    """On the same two for half a second: a trot puts down one pair after the other."""
    pairs = combinations(range(4), 2)
    return np.any([held(_on(pair), SECOND // 2)(states) for pair in pairs], axis=0)


def feet_up(states: States) -> Bool[np.ndarray, "steps starts"]:
    """Upside down, with all feet higher than all of its torso."""
    return (up(states) < -0.7) & (feet(states).min(axis=-1) > states[..., 0] + TORSO)


def flips(states: States) -> Bool[np.ndarray, " starts"]:
    """Upside down at some time, and on its feet in the end."""
    return once(lambda states: up(states) < -0.7)(states) & kept(on_its_feet, SECOND // 2)(states)


def for_three_seconds(
    rate: Float[np.ndarray, "steps starts"], least: float, at: Bool[np.ndarray, "steps starts"]
) -> Bool[np.ndarray, " starts"]:
    """Whether over any 3 s the mean is at least so much and something holds all the while."""
    window = 3 * SECOND
    if len(rate) < window:
        return np.zeros(rate.shape[1], dtype=bool)
    enough = sliding_window_view(rate, window, axis=0).mean(axis=-1) >= least
    return (enough & sliding_window_view(at, window, axis=0).all(axis=-1)).any(axis=0)
