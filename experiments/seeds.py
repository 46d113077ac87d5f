"""Several seeds of one body: trains and evaluates each on a core of its own and keeps raw results.

Runs go to `runs/experiments/NAME/SETTING-seedN` and resume when the command is given again. What
figures need of them is copied to `results/NAME/SETTING/seedN`: `config.json`, `metrics.jsonl` and
`evaluation.json`; what is there already is left as it is. Medians and intervals over seeds are in
`results/NAME/summary.json`. NAME is the body's, unless an experiment has one of its own.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue
from statistics import median
from typing import Any, NamedTuple

HERE = Path(__file__).resolve().parent.parent


class Setting(NamedTuple):
    """What is trained, how often, and how it is measured."""

    options: str
    """Of `everystate train`."""
    seeds: int
    evaluation: str = ""
    """Options of `everystate evaluate`."""


Settings = Mapping[str, Setting]
Column = Callable[[dict[str, Any]], float]
"""A share, read from an evaluation."""


def results_of(name: str) -> Path:
    """Where the raw results of a body or an experiment are kept."""
    return HERE / "results" / Path(name).stem


def run_of(name: str, setting: str, seed: int) -> Path:
    """The folder of one run."""
    return HERE / "runs" / "experiments" / Path(name).stem / f"{setting}-seed{seed}"


def train_and_evaluate(
    body: str, where: str, name: str, setting: Setting, seed: int, core: int, *, skills: bool
) -> None:
    """One seed, unless its results are there: train (or go on), evaluate, copy what is kept."""
    folder, kept = run_of(where, name, seed), results_of(where) / name / f"seed{seed}"
    if (kept / "evaluation.json").exists():
        return
    folder.parent.mkdir(parents=True, exist_ok=True)

    def call(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "everystate", *words],
            stdout=subprocess.PIPE,
            text=True,
            cwd=HERE,
            preexec_fn=lambda: os.sched_setaffinity(0, {core}),
        )
        if done.returncode == 130:  # Ctrl-C: the run is saved, and goes on when asked to again
            raise KeyboardInterrupt
        if done.returncode:
            print(f"{name} seed {seed}: `{' '.join(words)}` ended with {done.returncode}")
        return done.stdout

    run = str(folder.relative_to(HERE))
    period = ["--evaluation-period", "20"]
    call(
        "train",
        body,
        *setting.options.split(),
        "--seed",
        str(seed),
        *period,
        "--quiet",
        "--run-dir",
        run,
    )
    how = [*setting.evaluation.split(), *["--skills"] * skills]
    result = call("evaluate", run, "--json", *how).splitlines()
    kept.mkdir(parents=True, exist_ok=True)
    if result:
        (kept / "evaluation.json").write_text(json.dumps(json.loads(result[-1]), indent=1) + "\n")
    for file in ("config.json", "metrics.jsonl"):
        shutil.copy(folder / file, kept / file)
    print(f"{name} seed {seed}: in {kept.relative_to(HERE)}", flush=True)


def summarise(where: str, settings: Settings) -> dict[str, list[Path]]:
    """Writes summary.json; returns the folders of the seeds there are, by setting."""
    from everystate.evaluation.aggregate import over_seeds

    results = results_of(where)
    folders = {name: sorted((results / name).glob("seed*")) for name in settings}
    folders = {name: found for name, found in folders.items() if found}
    summaries = {}
    for name, found in folders.items():
        files = [folder / "evaluation.json" for folder in found]
        read = [json.loads(file.read_text()) for file in files if file.exists()]
        if read:
            summaries[name] = over_seeds(read)
    (results / "summary.json").write_text(json.dumps(summaries, indent=1) + "\n")
    return folders


def write_table(
    body: str, folders: Mapping[str, Sequence[Path]], columns: Mapping[str, Column]
) -> None:
    """settings.md: a row per setting, in per cent the median over its seeds and each of them."""
    lines = ["| setting | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for name, found in folders.items():
        files = [folder / "evaluation.json" for folder in found]
        read = [json.loads(file.read_text()) for file in files if file.exists()]
        values = [[round(100 * column(one)) for one in read] for column in columns.values()]
        cells = [f"{median(row):.0f} ({' '.join(map(str, row))})" for row in values if row]
        lines.append(" | ".join([f"| {name}", *cells]) + " |")
    (results_of(body) / "settings.md").write_text("\n".join(lines) + "\n")


def main(
    body: str,
    settings: Settings,
    draw: Callable[[dict[str, list[Path]]], None],
    *,
    description: str,
    skills: bool = False,
    name: str | None = None,
) -> None:
    """Every setting and seed asked for, one per core at a time; then the summary and figures."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--settings", nargs="+", default=list(settings), choices=settings)
    parser.add_argument("--seeds", nargs="+", type=int, help="instead of all of each setting")
    parser.add_argument("--summary-only", action="store_true")
    options = parser.parse_args()
    where = name or body
    cores: Queue[int] = Queue()
    for core in sorted(os.sched_getaffinity(0)):
        cores.put(core)

    def job(setting: str, seed: int) -> None:
        core = cores.get()
        try:
            train_and_evaluate(body, where, setting, settings[setting], seed, core, skills=skills)
        finally:
            cores.put(core)

    if not options.summary_only:
        with ThreadPoolExecutor(cores.qsize()) as pool:
            waiting = [
                pool.submit(job, name, seed)
                for name in options.settings
                for seed in options.seeds or range(settings[name].seeds)
            ]
            for future in waiting:
                future.result()
    draw(summarise(where, settings))
