"""Skills of the cartpole: x, cosine and sine of the pole's angle (up is 0), both velocities."""

import numpy as np
from jaxtyping import Bool, Float

from everystate.skills.skill import At, Rule, Skill, Starts, States, held, kept

_SECOND = 25  # control steps
RAIL = 1.8  # m from the middle to its ends, where a stop catches the cart
MARGIN = 0.2  # m off them, half a cart: whoever rams the stops turns the pole over blindly


def _hanging(rng: np.random.Generator, num: int) -> Float[np.ndarray, "starts 5"]:
    """At rest, within 0.1 rad of straight down, within 0.5 m of the middle."""
    angle = np.pi + rng.uniform(-0.1, 0.1, num)
    x, zero = rng.uniform(-0.5, 0.5, num), np.zeros(num)
    return np.stack([x, np.cos(angle), np.sin(angle), zero, zero], axis=1)


def _hanging_aside(rng: np.random.Generator, num: int) -> Float[np.ndarray, "starts 5"]:
    """The same, 0.5 to 1 m from the middle, on either side."""
    states = _hanging(rng, num)
    states[:, 0] += np.where(states[:, 0] < 0, -0.5, 0.5)
    return states


def _off_ends(states: States) -> Bool[np.ndarray, "steps starts"]:
    return np.abs(states[..., 0]) < RAIL - MARGIN


def _upright(states: States) -> Bool[np.ndarray, "steps starts"]:
    return states[..., 1] > np.cos(np.radians(18))


def _hangs_at(place: float) -> At:
    def at(states: States) -> Bool[np.ndarray, "steps starts"]:
        x, cosine, _, v, w = np.moveaxis(states, -1, 0)
        down = cosine < -np.cos(np.radians(18))
        return down & (np.abs(x - place) < 0.25) & (np.abs(v) < 0.5) & (np.abs(w) < 1.0)

    return at


def _turns(side: int) -> Rule:
    """Five whole turns of the pole, net, to the right (1) or the left (-1), off the ends."""

    def rule(states: States) -> Bool[np.ndarray, " starts"]:
        angle = np.unwrap(np.arctan2(states[..., 2], states[..., 1]), axis=0)
        turned = side * (angle[-1] - angle[0]) >= 5 * 2 * np.pi
        return turned & _off_ends(states).all(axis=0)

    return rule


def _passes_top(states: States) -> Bool[np.ndarray, " starts"]:
    """From its left to its right within a step, at the speed before and after, never at an end."""
    fast = _upright(states) & (np.abs(states[..., 4] - 5.0) < 1.0)
    left, off = states[..., 2] < 0, np.logical_and.accumulate(_off_ends(states), axis=0)
    passed = fast[:-1] & fast[1:] & left[:-1] & ~left[1:]
    return np.asarray((passed & off[1:]).any(axis=0))


def _hang(place: float, starts: Starts = _hanging) -> Skill:
    return Skill(
        text=f"from half a metre away or more, hang nearly still within 0.25 m of x = {place:+g} m"
        " for the last 2 of 10 s",
        goals=((place, -1.0, 0.0, 0.0, 0.0),),
        steps=10 * _SECOND,
        starts=starts,
        done=kept(_hangs_at(place), 2 * _SECOND),
    )


def _spin(name: str, side: int) -> Skill:
    # What only a turning pole comes back to: at 8 rad/s below, one that swings to and fro does too.
    goal = (0.0, 1.0, 0.0, 0.0, side * 6.0)
    return Skill(
        text=f"turn the pole over to the {name} at least 5 times in 10 s, the cart 0.2 m off the"
        " rail's ends all the while",
        goals=(goal,),
        steps=10 * _SECOND,
        starts=_hanging,
        done=_turns(side),
    )


SKILLS = {
    "balance": Skill(
        text="swing up from hanging and keep the pole within 18 degrees of upright, and the cart"
        " 0.2 m off the rail's ends, for 10 of 25 s",
        goals=((0.0, 1.0, 0.0, 0.0, 0.0),),
        steps=25 * _SECOND,
        starts=_hanging,
        done=held(lambda states: _upright(states) & _off_ends(states), 10 * _SECOND),
    ),
    "balance-anywhere": Skill(
        text="told the pole's angle and velocity and nothing of the cart, swing up from hanging and"
        " keep the pole within 18 degrees of upright, and the cart 0.2 m off the rail's ends, for"
        " 10 of 25 s",
        goals=({"pole_angle": 0.0, "pole_velocity": 0.0},),
        steps=25 * _SECOND,
        starts=_hanging,
        done=held(lambda states: _upright(states) & _off_ends(states), 10 * _SECOND),
    ),
    "spin-right": _spin("right", 1),
    "spin-left": _spin("left", -1),
    "hang-left": _hang(-1.0),
    "hang-middle": _hang(0.0, _hanging_aside),
    "hang-right": _hang(1.0),
    "pass-top": Skill(
        text="from hanging, pass the top to the right at 5 rad/s, give or take 1, the cart until"
        " then 0.2 m off the rail's ends",
        goals=((0.0, 1.0, 0.0, 0.0, 5.0),),
        steps=10 * _SECOND,
        starts=_hanging,
        done=_passes_top,
    ),
}
