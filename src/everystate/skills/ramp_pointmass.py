"""Skills of the Ramp Pointmass: x and y, from which its height follows.

Skills know no body, so the edges are stated here once more; a test holds them against the body's.
"""

import numpy as np
from jaxtyping import Bool, Float

from everystate.skills.skill import At, Skill, Starts, States, kept

LEDGE_SOUTH = 0.6  # m, of y, where the ledge begins; a ball below it comes as near as 0.55
RAMP_WEST, RAMP_FOOT = 0.5, -0.6  # m, of x and y, where the ramp begins


def on_ledge(states: Float[np.ndarray, "*n 2"]) -> Bool[np.ndarray, "*n"]:
    """Whether it is up there, and not on the floor beside it or on the ramp."""
    return states[..., 1] >= LEDGE_SOUTH


def on_floor(states: Float[np.ndarray, "*n 2"]) -> Bool[np.ndarray, "*n"]:
    """Whether it is at height 0."""
    on_ramp = (states[..., 0] >= RAMP_WEST) & (states[..., 1] > RAMP_FOOT)
    return ~on_ledge(states) & ~on_ramp


def _around(x: float, y: float) -> Starts:
    """Within 0.1 m of a place."""
    return lambda rng, num: np.array([x, y]) + rng.uniform(-0.1, 0.1, (num, 2))


def _near(x: float, y: float) -> At:
    """Within 0.25 m of a place along either axis."""
    return lambda states: np.abs(states - np.array([x, y])).max(axis=-1) < 0.25


def _up_at(x: float) -> At:
    """Near a place in the middle of the ledge's depth, and up there too."""
    near = _near(x, 0.8)
    return lambda states: near(states) & on_ledge(states)


def _climbs(states: States) -> Bool[np.ndarray, " starts"]:
    return on_floor(states[0]) & kept(_up_at(0.0), 5)(states)


def _crosses(states: States) -> Bool[np.ndarray, " starts"]:
    return on_ledge(states).all(axis=0) & kept(_up_at(-0.85), 5)(states)


def _comes_back(states: States) -> Bool[np.ndarray, " starts"]:
    near = _near(-0.3, -0.3)
    down = kept(lambda states: near(states) & on_floor(states), 5)
    return on_ledge(states[0]) & down(states)


SKILLS = {
    "climb": Skill(
        text="from the far corner of the floor up the ramp, be on the middle of the ledge for the"
        " last 5 steps, no fall",
        goals=((0.0, 0.8),),
        steps=120,
        starts=_around(-0.8, -0.8),
        done=_climbs,
        may_fall=False,
    ),
    "cross": Skill(
        text="from the top of the ramp to the far end of the ledge and never off it, be there for"
        " the last 5 steps",
        goals=((-0.85, 0.8),),
        steps=60,
        starts=_around(0.8, 0.8),
        done=_crosses,
        may_fall=False,
    ),
    "come-back": Skill(
        text="from the far end of the ledge down the ramp, be on the middle of the floor for the"
        " last 5 steps, no fall",
        goals=((0.75, 0.8), (0.75, -0.8), (-0.3, -0.3)),
        steps=150,
        starts=_around(-0.8, 0.8),
        done=_comes_back,
        may_fall=False,
    ),
}
