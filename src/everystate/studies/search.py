"""A search over options, by Optuna's sampler (TPE), which knows of all that was found before."""

import json
from concurrent.futures import FIRST_COMPLETED, wait
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from everystate.agent.files import read_json
from everystate.errors import EverystateError
from everystate.evaluation import raw
from everystate.evaluation.markdown import markdown
from everystate.studies import pool
from everystate.studies.plan import Range, Search, Study
from everystate.studies.runs import MEASURED, Training, finished, require_same
from everystate.training.rundir import write_atomically

_VALUES = "values.json"
"""In the folder of each run, what the search proposed."""


def search(
    study: Study, wanted: Search, out: Path, *, workers: int | None, address: str | None
) -> list[str]:
    """Makes the runs that are proposed until there are as many as wanted.

    Returns a line for each that failed; it counts as one, and the same command tries it again.

    Raises:
        EverystateError: Optuna is not installed, or the folder has runs of another search.
    """
    begun, scored = points(study, wanted, out)
    left = wanted.trials - len(scored)
    if left <= 0:
        return []
    if find_spec("optuna") is None:
        raise EverystateError("searches want Optuna, which is not installed: pip install optuna")
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    space = {name: _distribution(of) for name, of in wanted.space.items()}
    (one,) = study.conditions.values()
    # With the same seed the first proposals would be made again.
    sampler = optuna.samplers.TPESampler(seed=one.seeds[0] + len(scored), constant_liar=True)
    known = optuna.create_study(direction="maximize", sampler=sampler)
    for values, score in scored:
        known.add_trial(optuna.create_trial(params=values, distributions=space, value=score))
    for values in begun:
        known.enqueue_trial(values)
    problems: list[str] = []
    with pool.opened(out, workers, address) as open_pool:
        pending: dict[Any, Any] = {}
        while left or pending:
            if left and len(pending) < open_pool.size:
                trial = known.ask(space)
                run = study.found(trial.params)
                (out / run.name).mkdir(parents=True, exist_ok=True)
                write_atomically(out / run.name / _VALUES, json.dumps(trial.params) + "\n")
                pending[open_pool.submit([run])] = trial, run
                left -= 1
                continue
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                trial, run = pending.pop(future)
                if failed := future.result():
                    problems += failed
                    known.tell(trial, state=optuna.trial.TrialState.FAIL)
                else:
                    known.tell(trial, wanted.score(read_json(out / run.name / MEASURED)))
    return problems


def points(
    study: Study, wanted: Search, out: Path
) -> tuple[list[dict[str, Any]], list[tuple[dict[str, Any], float]]]:
    """Of a search's folder the values of runs that only begun, and of finished ones with scores.

    Raises:
        EverystateError: it has runs of another search.
    """
    begun, scored = [], []
    for path in sorted(out.glob(f"trial-*/{_VALUES}")):
        folder, values = path.parent, read_json(path)
        run = study.found(values)
        if folder.name != run.name or values.keys() != wanted.space.keys():
            raise EverystateError(f"{out} has runs of another search: choose another --out")
        assert isinstance(run.task, Training)
        require_same(run.task.config, folder)
        if finished(folder):
            scored.append((values, wanted.score(read_json(folder / MEASURED))))
        else:
            begun.append(values)
    return begun, scored


def write(wanted: Search, out: Path) -> str:
    """Writes summary.json and summary.md: a row for each finished run, best first; returns it."""
    found: list[dict[str, Any]] = []
    for path in sorted(out.glob(f"trial-*/{_VALUES}")):
        if finished(path.parent):
            score = wanted.score(read_json(path.parent / MEASURED))
            found.append({"run": path.parent.name, "score": score, "values": read_json(path)})
    found.sort(key=lambda one: -one["score"])
    rows = []
    for one in found:
        values = [_cell(one["values"][name]) for name in wanted.space]
        rows.append([one["run"], f"{one['score']:.3f}", *values])
    raw.write(out / "summary.json", {"runs": found}, replace=True)
    text = markdown(["run", wanted.metric, *wanted.space], rows)
    write_atomically(out / "summary.md", text)
    return text


def _cell(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _distribution(wanted: Range | tuple[Any, ...]) -> Any:
    from optuna import distributions

    if not isinstance(wanted, Range):
        return distributions.CategoricalDistribution(wanted)
    whole = isinstance(wanted.low, int) and isinstance(wanted.high, int)
    kind: Any = distributions.IntDistribution if whole else distributions.FloatDistribution
    return kind(wanted.low, wanted.high, log=wanted.log)
