"""Skills of the cartpole: x, cosine and sine of the pole's angle (up is 0), both velocities."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from everystate.skills.skill import Skill, States, held, kept, once

_SECOND = 25  # control steps


def _hanging(rng: np.random.Generator, num: int) -> Float[np.ndarray, "starts 5"]:
    """At rest, within 0.1 rad of straight down, within 0.5 m of the middle."""
    angle = np.pi + rng.uniform(-0.1, 0.1, num)
    x, zero = rng.uniform(-0.5, 0.5, num), np.zeros(num)
    return np.stack([x, np.cos(angle), np.sin(angle), zero, zero], axis=1)


def _upright(states: States) -> Bool[np.ndarray, "steps starts"]:
    return states[..., 1] > np.cos(np.radians(18))


def _hangs_at(place: float) -> Callable[[States], Bool[np.ndarray, "steps starts"]]:
    def at(states: States) -> Bool[np.ndarray, "steps starts"]:
        x, cosine, _, v, w = np.moveaxis(states, -1, 0)
        down = cosine < -np.cos(np.radians(18))
        return down & (np.abs(x - place) < 0.25) & (np.abs(v) < 0.5) & (np.abs(w) < 1.0)

    return at


def _turns(states: States) -> Float[np.ndarray, " starts"]:
    """Whole turns of the pole, net; to the right is positive."""
    angle = np.unwrap(np.arctan2(states[..., 2], states[..., 1]), axis=0)
    return (angle[-1] - angle[0]) / (2 * np.pi)


def _hang(place: float) -> Skill:
    return Skill(
        text=f"hang still at x = {place:+g} m for the last 2 of 10 s",
        goals=((place, -1.0, 0.0, 0.0, 0.0),),
        steps=10 * _SECOND,
        starts=_hanging,
        done=kept(_hangs_at(place), 2 * _SECOND),
    )


SKILLS = {
    "balance": Skill(
        text="swing up from hanging and keep the pole within 18 degrees of upright for 10 of 25 s",
        goals=((0.0, 1.0, 0.0, 0.0, 0.0),),
        steps=25 * _SECOND,
        starts=_hanging,
        done=held(_upright, 10 * _SECOND),
    ),
    # What only a turning pole comes back to: at 8 rad/s below, one that swings to and fro does too.
    "spin-right": Skill(
        text="turn the pole over to the right at least 5 times in 10 s",
        goals=((0.0, 1.0, 0.0, 0.0, 6.0),),
        steps=10 * _SECOND,
        starts=_hanging,
        done=lambda states: _turns(states) >= 5,
    ),
    "spin-left": Skill(
        text="turn the pole over to the left at least 5 times in 10 s",
        goals=((0.0, 1.0, 0.0, 0.0, -6.0),),
        steps=10 * _SECOND,
        starts=_hanging,
        done=lambda states: _turns(states) <= -5,
    ),
    "hang-left": _hang(-1.0),
    "hang-middle": _hang(0.0),
    "hang-right": _hang(1.0),
    "pass-top": Skill(
        text="pass the top, within 18 degrees, at 5 rad/s to the right, give or take 1",
        goals=((0.0, 1.0, 0.0, 0.0, 5.0),),
        steps=10 * _SECOND,
        starts=_hanging,
        done=once(lambda states: _upright(states) & (np.abs(states[..., 4] - 5.0) < 1.0)),
    ),
}
