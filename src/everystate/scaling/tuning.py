"""Sweeps on Ray Tune: as many runs at a time as there are cores, here or in a cluster."""

import contextlib
import json
import logging
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from everystate.agent.files import read_json
from everystate.errors import EverystateError
from everystate.scaling import trial as one
from everystate.scaling.plan import Range, Search, Sweep, Trial

_FAILURES = 2
"""How often a run that failed is tried again; it goes on from its last checkpoint."""
_COLUMNS = {
    "epoch": "epoch",
    "steps": "steps",
    "episode/reached": "goals reached",
    "score": "score",
}


def sweep(plan: Sweep, out: Path, *, address: str | None = None) -> None:
    """Trains and measures all runs of a sweep that are not finished.

    What stands in the folder says all: the same call goes on after a stop, whatever stopped it. On
    a cluster the folder must be one that all its machines share.

    Args:
        plan: what to run.
        out: gets a folder for each run, as in `trial.py`.
        address: of a Ray cluster, as `ray.init` takes it; None starts Ray on this machine alone.

    Raises:
        EverystateError: Ray is not installed or not reached, the folder has runs of other configs
            by the same names, or runs failed even when tried again; the others are finished.
    """
    if not find_spec("ray") or not find_spec("optuna"):
        raise EverystateError(
            "sweeps want Ray and Optuna: pip install 'ray[tune]' optuna, which are everystate's"
            " extra `scale`"
        )
    out = out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    if plan.search:
        left = plan.search.trials - len(_points(plan, plan.search, out)[1])
    else:
        trials = plan.trials()
        for trial in trials:
            one.require_same(trial, out)
        trials = [trial for trial in trials if not one.finished(out / trial.name)]
        left = len(trials)
    if left <= 0:
        return
    with _ray(address):
        problems, ended = _searched(plan, plan.search, out) if plan.search else _all(trials, out)
    if ended < left:
        raise KeyboardInterrupt  # which Tune answers by ending early
    if problems:
        raise EverystateError(
            f"{len(problems)} of {left} runs failed; the same command tries them again. The first:"
            f" {problems[0]}"
        )


def _all(trials: list[Trial], out: Path) -> tuple[list[str], int]:
    """Runs them all; returns what `_tuned` does."""
    from ray import tune

    named = {trial.name: trial for trial in trials}

    def work(given: Mapping[str, Any]) -> None:
        one.run(named[given["name"]], out, lambda metrics: tune.report(_shown(metrics)))

    return _tuned(
        work,
        len(trials),
        out,
        param_space={"name": tune.grid_search(list(named))},
        name=lambda trial: trial.config["name"].replace("/", "-"),
    )


def _searched(plan: Sweep, search: Search, out: Path) -> tuple[list[str], int]:
    """Runs what Optuna proposes, which knows of all that was found before; returns the same."""
    from ray import tune
    from ray.tune.search.optuna import OptunaSearch

    def work(values: Mapping[str, Any]) -> None:
        trial = plan.found(values)
        (out / trial.name).mkdir(exist_ok=True)
        (out / trial.name / "values.json").write_text(json.dumps(dict(values)) + "\n")
        # Optuna wants a score in every report.
        one.run(trial, out, lambda m: tune.report({**_shown(m), "score": float("nan")}))
        result = read_json(out / trial.name / "evaluation.json")
        tune.report({"epoch": trial.config.epochs, "score": search.score(result)})

    begun, scored = _points(plan, search, out)
    proposals = OptunaSearch(
        space={name: _distribution(wanted) for name, wanted in search.space.items()},
        metric="score",
        mode="max",
        points_to_evaluate=begun or None,
        seed=plan.seeds[0] + len(scored),  # else the first proposals would be made again
    )
    for values, score in scored:
        proposals.add_evaluated_point(values, score)
    left = search.trials - len(scored)
    return _tuned(
        work,
        left,
        out,
        tune_config={"search_alg": proposals, "num_samples": left},
        name=lambda trial: plan.found(trial.config).name,
    )


def _points(
    plan: Sweep, search: Search, out: Path
) -> tuple[list[dict[str, Any]], list[tuple[dict[str, Any], float]]]:
    """Values in the folder of runs that only begun, and of finished ones with their scores."""
    begun, scored = [], []
    for path in sorted(out.glob("trial-*/values.json")):
        with contextlib.suppress(OSError, ValueError):  # was killed while it was written
            values = read_json(path)
            if path.parent.name != plan.found(values).name or values.keys() != search.space.keys():
                raise EverystateError(f"{out} has runs of another search: choose another --out")
            one.require_same(plan.found(values), out)
            if one.finished(path.parent):
                score = search.score(read_json(path.parent / "evaluation.json"))
                scored.append((values, score))
            else:
                begun.append(values)
    return begun, scored


def _tuned(
    work: Callable[[Any], None],
    count: int,
    out: Path,
    *,
    name: Callable[[Any], str],
    param_space: dict[str, Any] | None = None,
    tune_config: Mapping[str, Any] | None = None,
) -> tuple[list[str], int]:
    """Lets Tune call `work`, on a core each time: why those failed that did, and how many ended."""
    from ray import tune

    config = {"trial_name_creator": name, "trial_dirname_creator": name, **(tune_config or {})}
    kept = out / ".ray"  # Of Tune's own; that one goes on is for our files to say.
    results = tune.Tuner(
        tune.with_resources(work, {"cpu": 1}),
        param_space=param_space,
        tune_config=tune.TuneConfig(**config),
        run_config=tune.RunConfig(
            storage_path=str(kept),
            failure_config=tune.FailureConfig(max_failures=_FAILURES),
            progress_reporter=tune.CLIReporter(
                metric_columns=_COLUMNS,
                parameter_columns=[],
                max_progress_rows=count,
                max_report_frequency=30,
            ),
            verbose=1,
        ),
    ).fit()
    shutil.rmtree(kept, ignore_errors=True)
    problems = [str(result.error).strip().splitlines()[-1] for result in results if result.error]
    return problems, len(problems) + sum(bool((r.metrics or {}).get("done")) for r in results)


def _distribution(wanted: Range | tuple[Any, ...]) -> Any:
    from optuna import distributions

    if not isinstance(wanted, Range):
        return distributions.CategoricalDistribution(wanted)
    whole = isinstance(wanted.low, int) and isinstance(wanted.high, int)
    kind = distributions.IntDistribution if whole else distributions.FloatDistribution
    return kind(wanted.low, wanted.high, log=wanted.log)  # type: ignore[arg-type]


def _shown(metrics: Mapping[str, Any]) -> dict[str, Any]:
    return {name: metrics[name] for name in _COLUMNS if name in metrics}


@contextlib.contextmanager
def _ray(address: str | None) -> Iterator[None]:
    """Ray, connected and told to be quiet and to leave the working directory alone."""
    os.environ |= {
        "RAY_CHDIR_TO_TRIAL_DIR": "0",
        "RAY_AIR_NEW_OUTPUT": "0",
        # By default its workers stand back for whatever else runs, and all but stop beside it.
        "RAY_worker_niceness": "0",
    }
    import ray

    local: dict[str, Any] = {"include_dashboard": False}
    if address is None:
        local["num_cpus"] = len(os.sched_getaffinity(0))
    try:
        ray.init(address, log_to_driver=False, logging_level=logging.ERROR, **local)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise EverystateError(
            f"no Ray cluster answers at {address} ({error}): start one by `ray start --head`, or"
            " leave out --ray-address to use this machine alone"
        ) from error
    try:
        yield
    finally:
        ray.shutdown()
