"""The study of a TOML file: all its runs, and what they come to."""

from pathlib import Path

from everystate.studies import pool, readings, summary
from everystate.studies.plan import Study
from everystate.studies.runs import Training, finished, require_same
from everystate.studies.tables import table


def sweep(
    study: Study, out: Path, *, workers: int | None = None, address: str | None = None
) -> list[str]:
    """Trains and measures all runs of a study that are not finished.

    What stands in the folder says all: the same call goes on after a stop, whatever stopped it. On
    a cluster the folder must be one that all its machines share.

    Args:
        study: what to run.
        out: gets a folder for each run, as in `runs.py`.
        workers: how many runs are made at a time, by default as many as there are cores.
        address: of a Ray cluster, HOST:PORT or auto; None is this machine.

    Returns:
        A line for each run that failed; the others are finished.

    Raises:
        EverystateError: the folder has runs of other configs by the same names; or there is no such
            cluster, or no Ray.
    """
    runs = study.runs()
    for run in runs:
        assert isinstance(run.task, Training)
        require_same(run.task.config, out / run.name)
    left = [[run] for run in runs if not finished(out / run.name)]
    return pool.run_all(left, out, workers=workers, address=address)


def write(study: Study, out: Path) -> str:
    """Writes summary.json, .md and .png, and readings.json and .md; returns the tables."""
    text = table(summary.write(out, summary.folders(out, study.conditions)))
    if study.readings:
        text += "\n" + readings.write(study.readings, study.conditions, out)
    return text
