"""Named skills: where to send an agent, and when that counts as done. No training knows of them.

A skill is a goal that is kept, or a few that follow one another, and a rule over the states that
were recorded on the way. All states are in the body's own units.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from everystate.errors import EverystateError, suggest

States = Float[np.ndarray, "steps starts state"]
Rule = Callable[[States], Bool[np.ndarray, " starts"]]
Starts = Callable[[np.random.Generator, int], Float[np.ndarray, "starts state"]]


@dataclass(frozen=True)
class Skill:
    """What to ask for and how to tell whether it was done."""

    text: str
    goals: tuple[tuple[float, ...], ...]
    """States to reach one after the other, each for an equal share of the steps."""
    steps: int
    """Control steps in all."""
    starts: Starts
    done: Rule
    """Of states [steps + 1, starts, state], which starts led to success."""
    may_fall: bool = True
    """Whether a fall on the way (`falls` of the body) still counts."""

    def goal(self, step: int) -> tuple[float, ...]:
        """The goal at a step; the last one is kept."""
        return self.goals[min(step * len(self.goals) // self.steps, len(self.goals) - 1)]


def skills_of(body: str) -> dict[str, Skill]:
    """All skills of a body.

    Raises:
        EverystateError: it has none.
    """
    if body not in SKILLS:
        raise EverystateError(f"{body} has no named skills; these have: {', '.join(SKILLS)}")
    return SKILLS[body]


def skill(body: str, name: str) -> Skill:
    """A skill by its name.

    Raises:
        EverystateError: the body has no such skill, or none at all.
    """
    known = skills_of(body)
    if name not in known:
        raise EverystateError(f"{body} has no skill {name!r}: {suggest(name, known)}")
    return known[name]


# --- Rules ---


def held(at: Callable[[States], Bool[np.ndarray, "steps starts"]], steps: int) -> Rule:
    """For so many steps in a row, at any time."""

    def rule(states: States) -> Bool[np.ndarray, " starts"]:
        inside = np.concatenate([np.zeros((1, states.shape[1]), bool), at(states)])
        total = inside.cumsum(axis=0)
        return (total[steps:] - total[:-steps] == steps).any(axis=0)

    return rule


def kept(at: Callable[[States], Bool[np.ndarray, "steps starts"]], steps: int) -> Rule:
    """At each of the last so many steps."""
    return lambda states: np.asarray(at(states)[-steps:].all(axis=0))


def once(at: Callable[[States], Bool[np.ndarray, "steps starts"]]) -> Rule:
    """At any one step."""
    return lambda states: np.asarray(at(states).any(axis=0))


# --- Cartpole: x, cosine and sine of the pole's angle (up is 0), and both velocities ---

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


_CARTPOLE = {
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

# --- Ramp Pointmass: x and y; the ledge begins at y = 0.6, the ramp at x = 0.5 ---


def _around(x: float, y: float) -> Starts:
    """Within 0.1 m of a place."""
    return lambda rng, num: np.array([x, y]) + rng.uniform(-0.1, 0.1, (num, 2))


def _near(x: float, y: float) -> Callable[[States], Bool[np.ndarray, "steps starts"]]:
    return lambda states: np.abs(states - np.array([x, y])).max(axis=-1) < 0.25


_RAMP = {
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

SKILLS: dict[str, dict[str, Skill]] = {"cartpole": _CARTPOLE, "ramp-pointmass": _RAMP}
