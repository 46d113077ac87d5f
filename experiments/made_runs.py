"""What studies have in common that measure runs which `everystate train` has made."""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from everystate.agent.files import read_lines
from everystate.evaluation import raw

_DIGITS = 4


def write_missing(
    description: str,
    trained: Mapping[str, Sequence[str]],
    results: Path,
    measured: Callable[[Path], dict[str, Any]],
) -> None:
    """Writes results/NAME.json of every run that is over and has none, and says what is missing.

    Args:
        description: of the study; its first line is shown with --help.
        trained: options of `everystate train` by the name of the run.
        results: the folder.
        measured: what is said of a run.
    """
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    runs = parser.parse_args().runs
    for name, options in trained.items():
        run, path = runs / name, results / f"{name}.json"
        if path.exists():
            continue
        if not (run / "config.json").exists():
            print(f"not run: everystate train {' '.join(options)} --run-dir {run}")
        elif not _over(run):
            print(f"not over: {run}")
        else:
            raw.write(path, measured(run))
            print(path)


def curves(lines: Sequence[Mapping[str, Any]], kept: tuple[str, ...]) -> dict[str, list[Any]]:
    """Columns of a run's metrics whose names begin so, in few digits."""
    columns = dict.fromkeys(n for line in lines for n in line if n.startswith(kept))
    return {n: [_short(line.get(n)) for line in lines] for n in columns}


def _over(run: Path) -> bool:
    """Whether it has all its epochs, or broke down."""
    config = json.loads((run / "config.json").read_text())["config"]
    lines = read_lines(run / "metrics.jsonl")
    broke = config["not_finite"] == "stop" and (run / "faults").exists()
    return broke or bool(lines and lines[-1]["epoch"] >= config["epochs"])


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.{_DIGITS}g}")
