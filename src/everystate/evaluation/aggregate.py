"""One number and its uncertainty over several seeds: never a mean of few runs without a range."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import stats

from everystate.errors import EverystateError

CONFIDENCE = 0.9
_RESAMPLES = 10_000
_DESCRIBED = ("tasks", "sigma", "made_from_seed", "starts")
"""Of a result: what is no measurement, or one for each task."""


def interquartile_mean(
    values: Float[np.ndarray, "*n seeds"], axis: int = -1
) -> Float[np.ndarray, "*n"]:
    """The mean of the middle half; of three seeds or fewer, the mean of all."""
    return np.asarray(stats.trim_mean(values, 0.25, axis=axis))


def summary(values: Sequence[float]) -> dict[str, Any]:
    """Median, interquartile mean and the 90 % bootstrap interval of the latter, over seeds."""
    seeds = np.asarray(values, dtype=np.float64)
    if seeds.ndim != 1 or not len(seeds) or not np.isfinite(seeds).all():
        raise EverystateError(f"cannot summarise {list(values)}: finite numbers are needed")
    low = high = None
    if len(seeds) > 1:
        interval = stats.bootstrap(
            (seeds,),
            interquartile_mean,
            n_resamples=_RESAMPLES,
            confidence_level=CONFIDENCE,
            method="percentile",  # the corrected ones are undefined where all seeds agree
            rng=np.random.default_rng(0),
        ).confidence_interval
        low, high = float(interval.low), float(interval.high)
    return {
        "median": float(np.median(seeds)),
        "iqm": float(interquartile_mean(seeds)),
        "low": low,
        "high": high,
        "values": seeds.tolist(),
    }


def over_seeds(results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Evaluation results of several seeds of one setting as one, every number a `summary`.

    Numbers that a seed lacks (None) are left out of that summary; `values` shows how many remain.
    """
    if not results:
        raise EverystateError("no results to aggregate")
    bodies = {result["body"] for result in results}
    if len(bodies) > 1:
        raise EverystateError(f"results are of different bodies: {', '.join(sorted(bodies))}")
    seeds = [result["config"]["seed"] for result in results]
    if len(set(seeds)) < len(seeds):
        raise EverystateError(f"training seeds are {sorted(seeds)}: each may occur only once")
    measured = ("score", "suites", "skills", "coverage")
    combined: dict[str, Any] = {"body": bodies.pop(), "seeds": seeds}
    for path in dict.fromkeys(p for r in results for p in _numbers(r, measured)):
        values = [float(value) for r in results if (value := _at(r, path)) is not None]
        place = combined
        for name in path[:-1]:
            place = place.setdefault(name, {})
        place[path[-1]] = summary(values)
    return combined


def _numbers(
    tree: Mapping[str, Any], names: Sequence[str], above: tuple[str, ...] = ()
) -> Iterator[tuple[str, ...]]:
    """Paths to all numbers below the named branches."""
    for name in names:
        value = tree.get(name)
        if isinstance(value, Mapping):
            inner = [n for n in value if n not in _DESCRIBED]
            yield from _numbers(value, inner, (*above, name))
        elif isinstance(value, (int, float)):
            yield (*above, name)


def _at(tree: Any, path: tuple[str, ...]) -> float | int | None:
    for name in path:
        tree = tree.get(name) if isinstance(tree, Mapping) else None
    return tree
