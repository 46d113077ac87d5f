"""Many runs on Ray Tune: as many at a time as there are cores, here or in a cluster."""

import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from everystate.agent.files import read_json
from everystate.errors import EverystateError
from everystate.evaluation.provenance import command
from everystate.scaling import trial as one
from everystate.scaling.cluster import connected
from everystate.scaling.plan import Range, Search, Sweep, Trial
from everystate.training.rundir import write_atomically

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
    if plan.search:
        return _search(plan, plan.search, out.resolve(), address)
    for trial in plan.trials():
        one.require_same(trial, out)
    run_all(plan.trials(), out, address=address)


def run_all(trials: Sequence[Trial], out: Path, *, address: str | None = None) -> None:
    """The same for runs that one has listed; finished ones are left, whatever their config was."""
    out, typed = out.resolve(), command()  # a worker of Ray has one of its own
    named = {trial.name: trial for trial in trials if not one.finished(out / trial.name)}

    def work(given: Mapping[str, Any]) -> None:
        from ray import tune

        def report(metrics: Mapping[str, Any]) -> None:
            tune.report(_shown(metrics))

        one.run(named[given["name"]], out, report, command=typed)

    if not named:
        return
    with connected(address, len(os.sched_getaffinity(0))):
        from ray import tune

        _tuned(
            work,
            out,
            param_space={"name": tune.grid_search(list(named))},
            num_samples=1,
            count=len(named),
            trial_name_creator=lambda trial: trial.config["name"].replace("/", "-"),
        )


def _search(plan: Sweep, search: Search, out: Path, address: str | None) -> None:
    """Runs what Optuna proposes, which knows of all that was found before."""
    typed = command()

    def work(values: Mapping[str, Any]) -> None:
        from ray import tune

        trial = plan.found(values)
        (out / trial.name).mkdir(parents=True, exist_ok=True)
        write_atomically(out / trial.name / "values.json", json.dumps(dict(values)) + "\n")

        def report(metrics: Mapping[str, Any]) -> None:
            tune.report({**_shown(metrics), "score": float("nan")})  # Optuna wants one in each

        one.run(trial, out, report, command=typed)
        result = read_json(out / trial.name / "evaluation.json")
        tune.report({"epoch": trial.config.epochs, "score": search.score(result)})

    begun, scored = points(plan, search, out)
    left = search.trials - len(scored)
    if left <= 0:
        return
    if find_spec("optuna") is None:
        raise EverystateError("searches want Optuna, which is not installed: pip install optuna")
    with connected(address, len(os.sched_getaffinity(0))):
        from ray.tune.search.optuna import OptunaSearch

        proposals = OptunaSearch(
            space={name: _distribution(wanted) for name, wanted in search.space.items()},
            metric="score",
            mode="max",
            points_to_evaluate=begun or None,
            seed=plan.seeds[0] + len(scored),  # else the first proposals would be made again
        )
        for values, score in scored:
            proposals.add_evaluated_point(values, score)
        _tuned(
            work,
            out,
            search_alg=proposals,
            num_samples=left,
            count=left,
            trial_name_creator=lambda trial: plan.found(trial.config).name,
        )


def points(
    plan: Sweep, search: Search, out: Path
) -> tuple[list[dict[str, Any]], list[tuple[dict[str, Any], float]]]:
    """Of a search's folder the values of runs that only begun, and of finished ones with scores.

    Raises:
        EverystateError: it has runs of another search.
    """
    begun, scored = [], []
    for path in sorted(out.glob("trial-*/values.json")):
        values = read_json(path)
        if path.parent.name != plan.found(values).name or values.keys() != search.space.keys():
            raise EverystateError(f"{out} has runs of another search: choose another --out")
        one.require_same(plan.found(values), out)
        if one.finished(path.parent):
            scored.append((values, search.score(read_json(path.parent / "evaluation.json"))))
        else:
            begun.append(values)
    return begun, scored


def _tuned(
    work: Callable[[Any], None],
    out: Path,
    *,
    count: int,
    param_space: dict[str, Any] | None = None,
    trial_name_creator: Callable[[Any], str],
    **tune_config: Any,
) -> None:
    """Lets Tune call `work` `count` times, on a core each."""
    from ray import tune

    names = {
        "trial_name_creator": trial_name_creator,
        "trial_dirname_creator": trial_name_creator,
    }
    kept = out / ".ray"  # Of Tune's own; that one goes on is for our files to say.
    results = tune.Tuner(
        tune.with_resources(work, {"cpu": 1}),
        param_space=param_space,
        tune_config=tune.TuneConfig(**names, **tune_config),
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
    ended = sum(bool((result.metrics or {}).get("done")) for result in results)
    if ended + len(problems) < count:
        raise KeyboardInterrupt  # which Tune answers by ending early
    if problems:
        raise EverystateError(
            f"{len(problems)} of {count} runs failed; the same command tries them again. The first:"
            f" {problems[0]}"
        )


def _distribution(wanted: Range | tuple[Any, ...]) -> Any:
    from optuna import distributions

    if not isinstance(wanted, Range):
        return distributions.CategoricalDistribution(wanted)
    whole = isinstance(wanted.low, int) and isinstance(wanted.high, int)
    kind: Any = distributions.IntDistribution if whole else distributions.FloatDistribution
    return kind(wanted.low, wanted.high, log=wanted.log)


def _shown(metrics: Mapping[str, Any]) -> dict[str, Any]:
    return {name: metrics[name] for name in _COLUMNS if name in metrics}
