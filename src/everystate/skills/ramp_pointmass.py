"""Skills of the Ramp Pointmass: x and y; the ledge begins at y = 0.6, the ramp at x = 0.5."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool

from everystate.skills.skill import Skill, Starts, States, kept


def _around(x: float, y: float) -> Starts:
    """Within 0.1 m of a place."""
    return lambda rng, num: np.array([x, y]) + rng.uniform(-0.1, 0.1, (num, 2))


def _near(x: float, y: float) -> Callable[[States], Bool[np.ndarray, "steps starts"]]:
    return lambda states: np.abs(states - np.array([x, y])).max(axis=-1) < 0.25


SKILLS = {
    "climb": Skill(
        text="from the far corner of the floor up the ramp to the middle of the ledge, no fall",
        goals=((0.0, 0.8),),
        steps=120,
        starts=_around(-0.8, -0.8),
        done=kept(_near(0.0, 0.8), 5),
        may_fall=False,
    ),
    "cross": Skill(
        text="along the ledge from the top of the ramp to its far end, no fall",
        goals=((-0.85, 0.8),),
        steps=60,
        starts=_around(0.8, 0.8),
        done=kept(_near(-0.85, 0.8), 5),
        may_fall=False,
    ),
    "come-back": Skill(
        text="from the far end of the ledge back down the ramp to the middle of the floor, no fall",
        goals=((0.75, 0.8), (0.75, -0.8), (-0.3, -0.3)),
        steps=150,
        starts=_around(-0.8, 0.8),
        done=kept(_near(-0.3, -0.3), 5),
        may_fall=False,
    ),
}
