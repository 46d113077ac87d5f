"""What is measured of trajectories and goals, on plain arrays.

A body is near a goal, within eps, where its scored components differ from the goal's by at most eps
in units of sigma, their spread over a reference set. Two measures: the largest difference (`max`),
and the root of the mean of their squares (`rms`), which one component of many does not decide.
Three readings: near it at any step (`hit`), at the last (`end`), and for what share of them (`at`).
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

EPS = (0.25, 0.5, 1.0)
"""The tolerances reported, in units of sigma."""
_FEW = 12

Groups = Mapping[str, Bool[np.ndarray, " tasks"]]
"""Which tasks belong to which group, by its name."""
Distance = Float[np.ndarray, "steps tasks"]


class Approach(NamedTuple):
    """How near to their goals bodies came, and when they were nearest by rms; in units of sigma."""

    nearest: Float[np.ndarray, " tasks"]
    """rms over all components, at the step where it was least."""
    pose: Float[np.ndarray, " tasks"]
    """rms over all but the velocities at that step."""
    velocity: Float[np.ndarray, " tasks"]
    """rms over velocities at that step; NaN for a body that has none."""


def differences(
    states: Float[np.ndarray, "steps tasks scored"],
    goals: Float[np.ndarray, "tasks scored"],
    sigma: Float[np.ndarray, " scored"],
    angular: Bool[np.ndarray, " scored"] | None = None,
) -> Float[np.ndarray, "steps tasks scored"]:
    """`|s_i - g_i| / sigma_i`; differences of angles (radians) are taken the short way."""
    apart = np.asarray(states, dtype=np.float64) - goals
    if angular is not None and angular.any():
        wrapped = np.mod(apart + math.pi, 2 * math.pi) - math.pi
        apart = np.where(angular, wrapped, apart)
    return np.abs(apart) / sigma


def largest(
    apart: Float[np.ndarray, "steps tasks scored"], weights: Float[np.ndarray, "tasks scored"]
) -> Distance:
    """The largest difference among the components of a weight above 0."""
    return np.where(weights > 0, apart, 0.0).max(axis=-1)


def rms(
    apart: Float[np.ndarray, "steps tasks scored"], weights: Float[np.ndarray, "tasks scored"]
) -> Distance:
    """The weighted root mean square of the differences; NaN where no component has weight."""
    total = weights.sum(axis=-1)
    squares = (weights * apart**2).sum(axis=-1) / np.where(total > 0, total, np.nan)
    return np.sqrt(squares)


def chief(components: int) -> str:
    """Which measure a motion is told by: `max`, or `rms` for a body of more than 12 components.

    Of many components one is nearly always beside the goal, by what noise alone does.
    """
    return "max" if components <= _FEW else "rms"


def within(horizons: Int[np.ndarray, " tasks"], steps: int) -> Bool[np.ndarray, "{steps} tasks"]:
    """Which steps 1, 2, ... of a rollout count for which task."""
    return np.arange(steps)[:, None] < horizons


def readings(
    distance: Distance, horizons: Int[np.ndarray, " tasks"], eps: float
) -> dict[str, Float[np.ndarray, " tasks"]]:
    """Per task: near its goal at any step, at the last, and for what share of the steps.

    `distance` starts with the state after the first action; steps beyond a task's horizon do not
    count.
    """
    near = (distance <= eps) & within(horizons, len(distance))
    last: np.ndarray = near[horizons - 1, np.arange(len(horizons))]
    return {
        "hit": np.asarray(near.any(axis=0), np.float64),
        "end": np.asarray(last, np.float64),
        "at": np.asarray(near.sum(axis=0) / horizons),
    }


def success(
    distance: Distance, horizons: Int[np.ndarray, " tasks"], groups: Groups
) -> dict[str, dict[str, dict[str, float]]]:
    """`[group][eps][reading]`: means over the tasks of a group; eps as in "0.25", "0.5" and "1"."""
    table: dict[str, dict[str, dict[str, float]]] = {name: {} for name in groups}
    for eps in EPS:
        for reading, values in readings(distance, horizons, eps).items():
            for name, chosen in groups.items():
                table[name].setdefault(f"{eps:g}", {})[reading] = float(values[chosen].mean())
    return table


def approach(
    apart: Float[np.ndarray, "steps tasks scored"],
    weights: Float[np.ndarray, "tasks scored"],
    velocities: Bool[np.ndarray, " scored"],
    horizons: Int[np.ndarray, " tasks"],
) -> Approach:
    """The step of each task at which the body was nearest to its goal, within the horizon."""
    distance = np.where(within(horizons, len(apart)), rms(apart, weights), np.inf)
    at = distance.argmin(axis=0), np.arange(len(horizons))
    found = apart[at][None]
    pose, velocity = (rms(found, weights * part)[0] for part in (~velocities, velocities))
    return Approach(distance[at], pose, velocity)


def medians(found: Approach, groups: Groups) -> dict[str, dict[str, float | None]]:
    """`[group]["nearest" | "pose" | "velocity"]`: medians over tasks, None where there are none."""

    def median(values: Float[np.ndarray, " tasks"]) -> float | None:
        known = values[np.isfinite(values)]
        return float(np.median(known)) if known.size else None

    return {
        name: {part: median(values[chosen]) for part, values in found._asdict().items()}
        for name, chosen in groups.items()
    }


def first_steps(
    distance: Distance, horizons: Int[np.ndarray, " tasks"], eps: float
) -> Float[np.ndarray, " tasks"]:
    """Control steps until first within eps of the goal; NaN where it never came so near."""
    near = (distance <= eps) & within(horizons, len(distance))
    return np.where(near.any(axis=0), near.argmax(axis=0) + 1.0, np.nan)


def calibration(
    predicted: Float[np.ndarray, " tasks"], measured: Float[np.ndarray, " tasks"]
) -> dict[str, Any]:
    """-V(start, goal) against measured steps, over the goals that were reached.

    Both are None where too few goals were reached for them to mean anything, or predictions are
    not finite, as of an agent that makes none.
    """
    from scipy.stats import rankdata  # which takes half a second to import

    reached = np.isfinite(measured)
    predicted, measured = np.asarray(predicted, np.float64)[reached], measured[reached]
    result: dict[str, Any] = {"mae": None, "spearman": None, "reached": int(reached.sum())}
    if not np.isfinite(predicted).all():
        return result
    if len(measured):
        result["mae"] = float(np.abs(predicted - measured).mean())
    if len(measured) > 2 and np.ptp(predicted) > 0 and np.ptp(measured) > 0:
        ranks = rankdata(predicted), rankdata(measured)
        result["spearman"] = float(np.corrcoef(*ranks)[0, 1])
    return result


def rate(events: Bool[np.ndarray, "steps tasks"], horizons: Int[np.ndarray, " tasks"]) -> float:
    """Events per 1,000 control steps."""
    return float(1000 * (events & within(horizons, len(events))).sum() / horizons.sum())
