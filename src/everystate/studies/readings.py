"""What runs logged of themselves after chosen epochs, seed by seed, and how well they kept it.

Read are all runs of a study, finished or not: a study can be looked at while it runs.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from statistics import median
from typing import Any

from everystate.errors import EverystateError, suggest
from everystate.evaluation import raw
from everystate.evaluation.markdown import markdown
from everystate.studies.plan import Readings
from everystate.studies.runs import finished
from everystate.studies.summary import seed_of
from everystate.training.logging import read_metrics
from everystate.training.rundir import write_atomically

NONE = "–"
Values = list[float | None]
"""A number for each seed; None where it is not known, as the run has not come so far."""


def write(readings: Readings, conditions: Iterable[str], out: Path) -> str:
    """Writes readings.json and readings.md; returns the text of the latter.

    Raises:
        EverystateError: no run has logged a column of this name, though there are some.
    """
    runs = {name: sorted((out / name).glob("seed*"), key=seed_of) for name in conditions}
    logged = {name: [_metrics(run) for run in found] for name, found in runs.items()}
    columns = {n for found in logged.values() for lines in found for line in lines for n in line}
    result: dict[str, Any] = {}
    for column in readings.names:
        # A run that has only begun may not have looked yet.
        if column not in columns and any(finished(run) for found in runs.values() for run in found):
            raise EverystateError(f"no run has logged {column!r}: {suggest(column, columns)}")
        result[column] = {
            name: gather(column, readings.epochs, found)
            | {"seeds": [seed_of(run) for run in runs[name]]}
            for name, found in logged.items()
        }
    raw.write(out / "readings.json", {"readings": result}, replace=True)
    text = "\n".join(table(column, found) for column, found in result.items())
    write_atomically(out / "readings.md", text)
    return text


def gather(
    column: str, epochs: Sequence[int], seeds: Sequence[Sequence[Mapping[str, int | float]]]
) -> dict[str, Any]:
    """One column of one condition: values by seed after these epochs, and the largest falls.

    Args:
        column: its name.
        epochs: after which it is told; without any, the last that a run has.
        seeds: the lines of the metrics of each.
    """
    known = [{int(x["epoch"]): float(x[column]) for x in s if column in x} for s in seeds]
    last = max((epoch for one in known for epoch in one), default=0)
    return {
        "epochs": {str(e): [one.get(e) for one in known] for e in epochs or (last,)},
        "largest_fall": [largest_fall(list(one.values())) if one else None for one in known],
    }


def largest_fall(values: Sequence[float]) -> float:
    """How far a series went below the best that it had reached before, at most."""
    return max(best - value for best, value in zip(accumulate(values, max), values, strict=True))


def table(column: str, conditions: Mapping[str, Mapping[str, Any]]) -> str:
    """A row per condition: every seed, their median and the worst, after each epoch.

    The greater a reading, the better; of falls below the best before, the largest is the worst.
    """
    epochs = list(dict.fromkeys(e for one in conditions.values() for e in one["epochs"]))
    heads = [column, "seeds"]
    for what in [*(f"epoch {epoch}" for epoch in epochs), "largest fall"]:
        heads += [what, "median", "worst"]
    rows = []
    for name, one in conditions.items():
        cells = [name, f"{len(one['seeds'])}"]
        for epoch in epochs:
            cells += _cells(one["epochs"].get(epoch, []), min)
        rows.append([*cells, *_cells(one["largest_fall"], max)])
    return markdown(heads, rows)


def _cells(values: Values, worst: Any) -> list[str]:
    known = [x for x in values if x is not None]
    if not known:
        return [NONE] * 3
    every = " ".join(map(_short, values))
    return [every, _short(median(known)), _short(worst(known))]


def _short(value: float | None) -> str:
    return NONE if value is None else f"{value:.2f}" if abs(value) < 10 else f"{value:.4g}"


def _metrics(run: Path) -> list[dict[str, int | float]]:
    """Of a run that is finished, or that has begun."""
    return read_metrics(run if (run / "metrics.jsonl").exists() else run / "run")
