"""Goals that ask for a part of a state: a value for some names, and nothing of the rest."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32
from numpy.typing import ArrayLike

from everystate.errors import EverystateError, suggest
from everystate.features import Feature, features, parts

Number = ArrayLike | float | int
States = ArrayLike | Sequence[float | int]
Goal = States | Mapping[str, Number]
"""A whole state, in the order of a body's components; or what is asked of it, by name."""
_TOLERANCE = 0.1
"""How far a direction that is asked for may be off length 1; it is then made so."""


class Asked(NamedTuple):
    """What is asked of some states, in the units of the body."""

    components: Float32[np.ndarray, "n state"]
    """NaN where nothing is asked of a component itself."""
    features: dict[str, Float32[np.ndarray, " n"]]
    """By name, as in `everystate.features`."""


def asked(goal: Mapping[str, Number], state_names: Sequence[str]) -> tuple[Asked, bool]:
    """What a goal by names asks for, and whether it is a single one.

    Args:
        goal: values by the names of components of the state, or of its features; arrays `[n]` for
            n goals at once.
        state_names: of the body.

    Raises:
        EverystateError: nothing asked, an unknown name, a value that is no finite number, arrays of
            different lengths, a feature beside a component that says it too, or a direction that
            is none.
    """
    known = features(state_names)
    if not goal:
        raise EverystateError("the goal asks for nothing: give at least one name and its value")
    for name in goal:
        if name not in known and name not in state_names:
            raise EverystateError(
                f"the goal asks for {name!r}: {suggest(str(name), [*state_names, *known])}"
            )
    values = {name: _numbers(name, value) for name, value in goal.items()}
    sizes = {len(value) for value in values.values() if value.ndim} or {1}
    if len(sizes) > 1:
        raise EverystateError(
            f"the goal has values for {' and '.join(map(str, sorted(sizes)))} states: give one"
            " number for each name, or arrays of the same length"
        )
    single, (num,) = not any(value.ndim for value in values.values()), sizes
    values = {name: np.broadcast_to(value, num) for name, value in values.items()}
    components = np.full((num, len(state_names)), np.nan, np.float32)
    for i, name in enumerate(state_names):
        if name in values:
            components[:, i] = values[name]
    wanted = {name: value for name, value in values.items() if name in known}
    _check(values, [known[name] for name in wanted])
    return Asked(_on_circle(components, state_names), wanted), single


def read(words: Sequence[str]) -> tuple[float, ...] | dict[str, float]:
    """A goal as it is written on a command line: numbers, or NAME=NUMBER of what is asked.

    Raises:
        EverystateError: a word that is neither, or words of both kinds.
    """
    pairs = [word.rpartition("=") for word in words]
    try:
        values = [float(value) for *_, value in pairs]
    except ValueError as error:
        raise EverystateError(
            f"the goal has {' '.join(words)!r}: give a number for each component, or NAME=NUMBER"
            " for what you ask for, as in height=0.6 forward_velocity=0.5"
        ) from error
    names = [name for name, *_ in pairs]
    if not any(equals for _, equals, _ in pairs):
        return tuple(values)
    if "" in names or len(set(names)) < len(names):
        raise EverystateError(
            f"the goal has {' '.join(words)!r}: give each name once, as NAME=NUMBER, or numbers"
            " alone for a whole state"
        )
    return dict(zip(names, values, strict=True))


def apart(
    states: Float[np.ndarray, "n state"],
    goal: Asked,
    state_names: Sequence[str],
    spread: Float[np.ndarray, " state"],
) -> Float[np.ndarray, "n asked"]:
    """How far states are from what is asked, the same of all of them, by name and in σ."""
    columns = (states - goal.components) / spread
    found = [np.abs(columns[:, ~np.isnan(columns).any(axis=0)])]
    for part in parts(state_names):
        values = part.read(states)
        for feature in part.features:
            if feature.name in goal.features:
                off = feature.difference(values[feature.name], goal.features[feature.name])
                found.append(np.abs(off / feature.spread(spread))[:, None])
    return np.concatenate(found, axis=1)


def _numbers(name: str, value: Number) -> Float32[np.ndarray, "..."]:
    try:
        numbers = np.asarray(value, np.float32)
    except (TypeError, ValueError) as error:
        raise EverystateError(f"the goal's {name} is {value!r}: give a number") from error
    if numbers.ndim > 1 or not np.isfinite(numbers).all():
        raise EverystateError(
            f"the goal's {name} is {value!r}: give a finite number, or an array [n] of them"
        )
    return numbers


def _check(values: Mapping[str, Number], features: Sequence[Feature]) -> None:
    for feature in features:
        for name in feature.components:
            if name in values:
                raise EverystateError(
                    f"the goal asks for {feature.name} and for {name}, which it is made of: leave"
                    " one of them out"
                )


def _on_circle(
    components: Float32[np.ndarray, "n state"], state_names: Sequence[str]
) -> Float32[np.ndarray, "n state"]:
    """With cosines and sines of length 1 where both are asked, and within 1 where one is."""
    for i, name in enumerate(state_names):
        if not name.startswith("cos_") or f"sin_{name[4:]}" not in state_names:
            continue
        pair = [i, state_names.index(f"sin_{name[4:]}")]
        length = np.hypot(*components[:, pair].T)
        lone = np.nan_to_num(np.abs(components[:, pair])).max(axis=1)
        off = np.where(np.isnan(length), np.maximum(lone - 1, 0), np.abs(length - 1))
        if (off > _TOLERANCE).any():
            worst = components[off.argmax(), pair]
            told = ", ".join(
                f"{state_names[at]} = {value:g}"
                for at, value in zip(pair, worst, strict=True)
                if math.isfinite(value)
            )
            raise EverystateError(
                f"the goal's {told} is of no angle: a cosine and its sine lie on a circle of"
                f" radius 1; ask for {name[4:]}_angle, in degrees"
            )
        scale = np.where(np.isnan(length), np.maximum(lone, 1), length)
        components[:, pair] /= scale[:, None]
    return components
