"""One run of a sweep: trained, measured, and its results kept.

Its folder gets `run/`, the run itself, and beside it what tables and figures need of it:
`config.json`, `metrics.jsonl` and, when all is done, `evaluation.json`.
"""

import fcntl
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from everystate import evaluation, training
from everystate.agent import config_to_json
from everystate.agent.files import read_json
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.evaluation import raw
from everystate.scaling.plan import Trial

Report = Callable[[Mapping[str, int | float]], None]


def finished(folder: Path) -> bool:
    """Whether the run in this folder is trained and measured."""
    return (folder / "evaluation.json").exists()


def require_same(trial: Trial, out: Path) -> None:
    """Complains of results by the trial's name that are of another config."""
    try:
        found = read_json(out / trial.name / "config.json")["config"]
    except FileNotFoundError:
        return
    except (OSError, ValueError, KeyError) as error:
        raise EverystateError(f"{out / trial.name} is damaged ({error}): move it away") from error
    wanted, unsaid = (_written(config) for config in (trial.config, Config()))
    there = {name: found.get(name, unsaid[name]) for name in wanted}  # older ones lack newer fields
    differing = [f"{n} {there[n]} there, {x} here" for n, x in wanted.items() if there[n] != x]
    if differing:
        raise EverystateError(
            f"{out / trial.name} has another config ({'; '.join(differing)}): choose another --out,"
            " or name the setting otherwise"
        )


def _written(config: Config) -> dict[str, Any]:
    """As a file has it, where tuples are lists."""
    return json.loads(json.dumps(config_to_json(config)))


def run(
    trial: Trial,
    out: Path,
    report: Report = lambda metrics: None,
    *,
    command: str | None = None,
) -> None:
    """Trains, or goes on, and measures; what is finished is left as it is.

    Args:
        trial: what to do.
        out: the sweep's folder.
        report: is called with the metrics of each epoch.
        command: what the results name as their command, where this process has one of its own.
    """
    folder = out / trial.name
    if finished(folder):
        return
    folder.mkdir(parents=True, exist_ok=True)
    with one_core():
        made = training.train(trial.config, run_dir=folder / "run", progress=False, on_epoch=report)
        result = evaluation.evaluate(made, **trial.evaluation._asdict())
    result["command"] = command or result["command"]
    for name in ("config.json", "metrics.jsonl"):
        shutil.copy(made / name, folder / name)
    raw.write(folder / "evaluation.json", result)


@contextmanager
def one_core() -> Iterator[None]:
    """Keeps to a core that no other run of a sweep on this machine has; anywhere if none is free.

    Runs that share cores wait for each other at every step. The system gives a core up again when
    its process ends, however it ends.
    """
    before = os.sched_getaffinity(0)
    locks = Path(tempfile.gettempdir()) / f"everystate-cores-{os.getuid()}"
    locks.mkdir(exist_ok=True)
    for core in sorted(before):
        lock = (locks / str(core)).open("w")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            continue
        with lock:
            os.sched_setaffinity(0, {core})
            try:
                yield
            finally:
                os.sched_setaffinity(0, before)
        return
    yield
