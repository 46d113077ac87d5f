"""Conditions over their seeds: numbers, tables and figures, from the files of a study alone."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from everystate.agent.json_files import read_json
from everystate.evaluation import raw
from everystate.evaluation.aggregate import over_seeds, summary
from everystate.studies.runs import MEASURED
from everystate.studies.tables import table
from everystate.training.logging import read_metrics
from everystate.training.rundir import write_atomically

_LARGEST = 20 * raw.LARGEST
"""Bytes: of many conditions, as it is made from files that are each within the bound."""
Groups = Mapping[str, Sequence[Path]]
"""Folders of runs, by condition."""


def folders(out: Path, conditions: Iterable[str], measured: str = MEASURED) -> Groups:
    """Of the finished runs of each condition, in the order of their seeds."""
    found = {name: sorted((out / name).glob("seed*"), key=seed_of) for name in conditions}
    return {name: [r for r in runs if (r / measured).exists()] for name, runs in found.items()}


def seed_of(run: Path) -> int:
    """N of CONDITION/seedN."""
    return int(run.name.removeprefix("seed"))


def write(out: Path, groups: Groups, *, name: str = "summary") -> dict[str, Any]:
    """What `gather` says, as NAME.json and NAME.md, and NAME.png; returns it.

    Drawn are curves over epochs; of more conditions than can be told apart, their scores in the
    end.
    """
    result = {"conditions": gather(groups)}
    write_numbers(out, result, name=name)
    draw(groups, out / f"{name}.png")
    return result


def write_numbers(out: Path, result: Mapping[str, Any], *, name: str) -> None:
    """NAME.json and NAME.md of a result."""
    raw.write(out / f"{name}.json", result, replace=True, largest=_LARGEST)
    write_atomically(out / f"{name}.md", table(result))


_CURVES = 5
"""More settings than these are no longer told apart as curves."""


def draw(groups: Groups, path: Path, *, over: Any = "epoch") -> None:
    """A figure of the runs that have metrics; none where no run has any."""
    from everystate.viewing.figures import comparison, settings

    grown = {name: [r for r in found if read_metrics(r)] for name, found in groups.items()}
    grown = {name: found for name, found in grown.items() if found}
    if grown:
        few = len(grown) <= _CURVES
        figure = comparison(grown, over=over) if few else settings(grown)
        figure.savefig(path, dpi=150)


def gather(
    groups: Groups, measured: str = MEASURED, *, equal_steps: int | None = None
) -> dict[str, Any]:
    """Evaluations over seeds, by condition; `summary` says what becomes of each number.

    A condition without runs has `seeds` of none and nothing else.

    Args:
        groups: folders of finished runs.
        measured: the file in each that has its evaluation.
        equal_steps: tell the scores after so many control steps too.
    """
    conditions: dict[str, Any] = {}
    for name, runs in groups.items():
        found = [read_json(run / measured) for run in runs]
        if not found:
            conditions[name] = {"seeds": []}
            continue
        conditions[name] = over_seeds(found)
        if all("steps" in one for one in found):
            conditions[name]["steps"] = summary([float(one["steps"]) for one in found])
        if equal_steps is not None:
            looks = [_scores_by(run, equal_steps) for run in runs]
            regions = dict.fromkeys(region for one in looks for region in one)
            conditions[name]["at_equal_steps"] = {
                r: summary([one[r] for one in looks if r in one]) for r in regions
            }
    return conditions


def _scores_by(run: Path, steps: int) -> dict[str, float]:
    """Scores by SUITE/GROUP at the last look before so many steps; empty without any."""
    found: dict[str, float] = {}
    for line in read_metrics(run):
        if line["steps"] <= steps:
            scored = [n.split("/") for n in line if n.startswith("eval/") and "/score/" in n]
            looked = {f"{s}/{g}": line[f"eval/{s}/score/{g}"] for _, s, _, g in scored}
            found = looked or found
    return found
