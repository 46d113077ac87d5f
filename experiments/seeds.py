"""What the studies of this folder have in common.

NAME.toml says what is run, as `everystate sweep` reads it; a script of the same name makes the runs
that are missing, as the same command would, and then measures or draws what is special to it. What
is finished is left as it is, also where its config would be another today.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from everystate import studies
from everystate.agent.json_files import read_lines
from everystate.studies import Study, summary
from everystate.studies.runs import finished

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "results"
_DIGITS = 4


def main(
    name: str, then: Callable[[Study, Path], None], *, description: str, out: Path | None = None
) -> None:
    """Makes the runs of experiments/NAME.toml, then does what is left to do.

    Args:
        name: of the study.
        then: is called with the study and its folder, also where runs failed.
        description: its first line is shown with --help.
        out: the study's folder, by default results/NAME.
    """
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--workers", type=int, help="runs at a time; by default one per core")
    parser.add_argument("--ray-address", help="a Ray cluster to make them on")
    parser.add_argument("--out", type=Path, default=out or RESULTS / name)
    parser.add_argument("--only", nargs="+", metavar="CONDITION/seedN", help="only these runs")
    parser.add_argument("--summary-only", action="store_true", help="train nothing")
    options = parser.parse_args()
    study, folder = studies.read(ROOT / "experiments" / f"{name}.toml"), options.out
    problems: list[str] = []
    if not options.summary_only:
        runs = [run for run in study.runs() if not options.only or run.name in options.only]
        if unknown := set(options.only or ()) - {run.name for run in runs}:
            parser.error(f"no such runs: {', '.join(sorted(unknown))}")
        left = [[run] for run in runs if not finished(folder / run.name)]
        how = {"workers": options.workers, "address": options.ray_address}
        problems = studies.run_all(left, folder, **how)
    then(study, folder)
    studies.complain(problems)


def summarised(study: Study, out: Path) -> dict[str, Sequence[Path]]:
    """Writes the summary; returns the folders of the finished runs there are, by condition."""
    groups = summary.folders(out, study.conditions)
    summary.write(out, groups)
    return {name: found for name, found in groups.items() if found}


def curves(lines: Sequence[Mapping[str, Any]], kept: tuple[str, ...]) -> dict[str, list[Any]]:
    """Columns of a run's metrics whose names begin so, in few digits."""
    columns = dict.fromkeys(n for line in lines for n in line if n.startswith(kept))
    return {n: [_short(line.get(n)) for line in lines] for n in columns}


def broke_down(run: Path) -> int | None:
    """The epoch in which a run that stops at what is not finite did so."""
    faults = sorted((run / "faults").glob("*"))
    return int(faults[0].name) if faults else None


def lines_of(run: Path) -> list[dict[str, Any]]:
    """The metrics of a run, whole or broken down."""
    return read_lines(run / "metrics.jsonl")


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.{_DIGITS}g}")
