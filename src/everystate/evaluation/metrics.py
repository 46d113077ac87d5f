"""What is measured of trajectories and goals, on plain arrays.

success@eps asks for `max_i |s_i - g_i| / sigma_i <= eps`: every scored component, pose and
velocity, in units of its spread over a reference set.
"""

import math
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

EPS = (0.25, 0.5, 1.0)
"""The tolerances reported, in units of sigma."""


def distances(
    states: Float[np.ndarray, "steps goals scored"],
    goals: Float[np.ndarray, "goals scored"],
    sigma: Float[np.ndarray, " scored"],
    angular: Bool[np.ndarray, " scored"] | None = None,
) -> Float[np.ndarray, "steps goals"]:
    """`max_i |s_i - g_i| / sigma_i`; differences of angles (radians) are taken the short way."""
    apart = np.asarray(states, dtype=np.float64) - goals
    if angular is not None and angular.any():
        wrapped = np.mod(apart + math.pi, 2 * math.pi) - math.pi
        apart = np.where(angular, wrapped, apart)
    return (np.abs(apart) / sigma).max(axis=-1)


def within(horizons: Int[np.ndarray, " goals"], steps: int) -> Bool[np.ndarray, "{steps} goals"]:
    """Which steps 1, 2, ... of a rollout count for which goal."""
    return np.arange(steps)[:, None] < horizons


def readings(
    distance: Float[np.ndarray, "steps goals"], horizons: Int[np.ndarray, " goals"], eps: float
) -> dict[str, Float[np.ndarray, " goals"]]:
    """Per goal: near it at `any` step, at the `last` step, and for what `fraction` of the steps.

    `distance` starts with the state after the first action; steps beyond a goal's horizon do not
    count.
    """
    near = (distance <= eps) & within(horizons, len(distance))
    last: np.ndarray = near[horizons - 1, np.arange(len(horizons))]
    return {
        "any": np.asarray(near.any(axis=0), np.float64),
        "last": np.asarray(last, np.float64),
        "fraction": np.asarray(near.sum(axis=0) / horizons),
    }


def by_region(
    values: Float[np.ndarray, " goals"], regions: Shaped[np.ndarray, " goals"]
) -> dict[str, float]:
    """Means over the goals of each region, in order of appearance, and over `all`."""
    names = dict.fromkeys(str(name) for name in regions)
    means = {name: float(values[regions == name].mean()) for name in names}
    return means | {"all": float(values.mean())}


def success(
    distance: Float[np.ndarray, "steps goals"],
    horizons: Int[np.ndarray, " goals"],
    regions: Shaped[np.ndarray, " goals"],
) -> dict[str, dict[str, dict[str, float]]]:
    """`[region][eps][reading]`, with eps written as in "0.25", "0.5" and "1"."""
    table: dict[str, dict[str, dict[str, float]]] = {}
    for eps in EPS:
        for reading, values in readings(distance, horizons, eps).items():
            for name, mean in by_region(values, regions).items():
                table.setdefault(name, {}).setdefault(f"{eps:g}", {})[reading] = mean
    return table


def first_steps(
    distance: Float[np.ndarray, "steps goals"], horizons: Int[np.ndarray, " goals"], eps: float
) -> Float[np.ndarray, " goals"]:
    """Control steps until first within eps of the goal; NaN where it never came so near."""
    near = (distance <= eps) & within(horizons, len(distance))
    return np.where(near.any(axis=0), near.argmax(axis=0) + 1.0, np.nan)


def calibration(
    predicted: Float[np.ndarray, " goals"], measured: Float[np.ndarray, " goals"]
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


def rate(events: Bool[np.ndarray, "steps goals"], horizons: Int[np.ndarray, " goals"]) -> float:
    """Events per 1,000 control steps."""
    return float(1000 * (events & within(horizons, len(events))).sum() / horizons.sum())
