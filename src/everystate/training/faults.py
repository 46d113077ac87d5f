"""An update that was not finite: what was the matter, and what is kept of it."""

from collections.abc import Mapping
from pathlib import Path

import jax
import numpy as np

from everystate.agent import Agent, files, named_arrays
from everystate.learning.guard import Fault

KEPT = 10
"""Faults of which a run keeps the batch; one that goes on may have many."""


def report(
    folder: Path, epoch: int, metrics: Mapping[str, int | float], fault: Fault, agent: Agent
) -> str | None:
    """What was not finite in an epoch, if anything was, and of which input.

    Keeps them in `faults/EPOCH` of the run: `batch.npz`, in scaled units, and the models that met
    it, as an exported agent. (A run that goes on keeps the models of the end of the epoch.)
    """
    if int(fault.update) < 0:
        wrong = not_finite(metrics)
        return f"in epoch {epoch}: {wrong[0]} is {metrics[wrong[0]]}" if wrong else None
    inputs = {name: np.asarray(array) for name, array in named_arrays(fault.batch).items()}
    of_update = {name: float(value) for name, value in jax.device_get(fault.metrics).items()}
    problem = f"{_wrong(of_update)}; {_input(inputs)}"
    at = f"in epoch {epoch}, update {int(fault.update) + 1}: {problem}"
    place = folder / "faults" / f"{epoch:06d}"
    if place.exists() or len(list(place.parent.glob("*"))) >= KEPT:
        return at
    place.mkdir(parents=True)
    np.savez_compressed(place / "batch.npz", **inputs)  # pyright: ignore
    files.write(place, agent.models, agent.scale, agent.config, agent.body)
    return f"{at}. Batch and models are in {place}"


def not_finite(metrics: Mapping[str, int | float]) -> list[str]:
    """The names of the metrics that are not."""
    return [name for name, value in metrics.items() if not np.isfinite(value)]


def _wrong(metrics: Mapping[str, int | float]) -> str:
    # A loss says which model it is, and comes before the gradient that it spoils.
    names = sorted(not_finite(metrics), key=lambda name: not name.startswith("loss/"))
    return ", ".join(f"{name} is {metrics[name]}" for name in names[:4])


def _input(inputs: Mapping[str, np.ndarray]) -> str:
    for name, array in inputs.items():
        if not np.isfinite(array).all():
            row, *component = np.argwhere(~np.isfinite(array))[0]
            place = f"row {row}, component {component[0]}" if component else f"row {row}"
            return f"its input {name} is {array[row, *component]} in {place}"
    # Goals that were pursued have no components where nobody asks for them [D24].
    numbers = {name: x for name, x in inputs.items() if x.dtype.kind == "f" and x.size}
    largest = {name: np.abs(array).max() for name, array in numbers.items()}
    name = max(largest, key=largest.__getitem__)
    return f"its inputs are finite, the largest is {largest[name]:.3g} in {name}"
