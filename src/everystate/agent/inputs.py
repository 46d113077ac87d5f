"""What a user gives an agent, checked: observations, and goals whole or in part."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from everystate.errors import EverystateError
from everystate.goals import Asked, Goal, States, asked


class Pairs(NamedTuple):
    """Observations and what is asked of each, as many of either; in the units of the body."""

    states: Float32[np.ndarray, "n state"]
    goals: Asked
    single: bool
    """Whether both came without a batch axis."""


def pairs(observation: States, goal: Goal, names: Sequence[str]) -> Pairs:
    """Both as batches of the same length.

    Raises:
        EverystateError: a wrong shape, a number that is not finite, batches of different lengths,
            or a goal that asks for nothing or for what there is not.
    """
    states = checked("observation", observation, names)
    if isinstance(goal, Mapping):
        goals, one = asked(goal, names)
    else:
        whole = checked("goal", goal, names)
        goals, one = Asked(np.atleast_2d(whole), {}), whole.ndim == 1
    single, states = states.ndim == 1 and one, np.atleast_2d(states)
    num, many = len(states), len(goals.components)
    if num != many and 1 not in (num, many):
        raise EverystateError(f"{num} observations and {many} goals: give as many of each, or one")
    size = max(num, many)
    components = np.broadcast_to(goals.components, (size, len(names)))
    features = {name: np.broadcast_to(x, size) for name, x in goals.features.items()}
    return Pairs(np.broadcast_to(states, components.shape), Asked(components, features), single)


def checked(what: str, value: States, names: Sequence[str]) -> Float32[np.ndarray, "*n state"]:
    """A state, or a batch of them; of a goal NaN is what it does not ask for.

    Raises:
        EverystateError: another shape, or a number that is not finite.
    """
    try:
        states = np.asarray(value, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise EverystateError(f"the {what} is no array of numbers: {error}") from error
    if states.ndim not in (1, 2) or states.shape[-1] != len(names):
        raise EverystateError(
            f"the {what} has shape {states.shape}: expected ({len(names)},) or "
            f"(n, {len(names)}), for {', '.join(names)}"
        )
    free = np.isnan(states) & (what == "goal")
    if not (free | np.isfinite(states)).all():
        place = tuple(np.argwhere(~(free | np.isfinite(states)))[0])
        raise EverystateError(
            f"the {what} is {states[place]} in {names[place[-1]]}: it must be finite"
        )
    if free.all(axis=-1).any():
        raise EverystateError("the goal is NaN in every component: give a number for at least one")
    return states
