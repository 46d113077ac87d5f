"""Commands that measure: `evaluate`, `score`, `compare` and `sweep`."""

import json
from pathlib import Path
from typing import Any

from everystate.cli.options import Compare, Evaluate, Score, Sweep
from everystate.cli.parsing import parse
from everystate.cli.progress import working
from everystate.errors import EverystateError


def evaluate(argv: list[str]) -> None:
    """Print what a run can reach."""
    options = parse(Evaluate, "evaluate", argv)
    from everystate import evaluation

    _refuse_existing(options.out)
    with working("measuring") as count:
        result = evaluation.evaluate(
            options.run,
            on_step=count,
            suite=options.suite or None,
            split=options.split,
            plan=options.plan,
            episodes=options.episodes,
            skills=options.skills,
            perturb=options.perturb == "grid",
        )
    _tell(result, options)


def score(argv: list[str]) -> None:
    """Print what a recording comes to."""
    options = parse(Score, "score", argv)
    _refuse_existing(options.out)
    from everystate import benchmark

    with working("scoring"):
        result = benchmark.score(options.file, options.suite)
    _tell(result, options)


def _refuse_existing(out: Path | None) -> None:
    if out and out.exists():
        raise EverystateError(f"{out} exists already: choose another --out")


def _tell(result: dict[str, Any], options: Evaluate | Score) -> None:
    """Writes and prints a result as the options say."""
    from everystate import evaluation
    from everystate.evaluation import raw

    if options.out:
        raw.write(options.out, result)
    if options.json:
        print(json.dumps(result))
        return
    for table in evaluation.tables(result):
        shown(table)


def compare(argv: list[str]) -> None:
    """Train and measure several agents side by side."""
    options = parse(Compare, "compare", argv)
    from everystate import studies

    shared = options.body, options.minutes, options.preset, options.episodes, options.plan
    out = options.out or Path("runs") / f"compare-{Path(options.body).stem}"
    if options.rescore:
        result = studies.rescore(options.body, out, workers=options.workers)
    else:
        terms = studies.Terms(*shared)
        how = {"workers": options.workers}
        result = studies.compare(terms, options.agents, options.seeds, out, **how)
    print(studies.table(result))
    print(f"in {out}")


def sweep(argv: list[str]) -> None:
    """Train and measure many runs."""
    options = parse(Sweep, "sweep", argv)
    from everystate import studies

    study = studies.read(options.file)
    out = options.out or Path("runs") / f"sweep-{options.file.stem}"
    failed: list[str] = []
    if not options.table_only:
        where = {"workers": options.workers, "address": options.ray_address}
        failed = studies.sweep(study, out, **where)
    print(studies.write(study, out), end="")
    print(f"in {out}")
    studies.complain(failed)


def shown(table: Any) -> None:
    """Prints a table."""
    from rich.console import Console

    Console().print(table)
