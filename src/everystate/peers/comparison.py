"""Agents side by side: the same body, harness and wall-clock, each on one core."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue
from typing import Any

from everystate.agent.files import read_json
from everystate.errors import EverystateError
from everystate.evaluation import suites
from everystate.evaluation.aggregate import over_seeds, summary
from everystate.peers import contestants
from everystate.peers.contest import Terms
from everystate.peers.tables import table
from everystate.presets import preset
from everystate.training.logging import read_metrics
from everystate.training.rundir import write_atomically

_MOST = 100_000


def compare(terms: Terms, agents: Sequence[str], seeds: int, folder: Path) -> dict[str, Any]:
    """Trains and measures every agent with every seed, as many at a time as there are cores.

    What is in the folder already is not done again, so the same command goes on after a stop.

    Args:
        terms: what is the same for all.
        agents: names from `contestants.CONTESTANTS`.
        seeds: how many, from 0.
        folder: gets `AGENT/seedN`, `comparison.json` with everything over seeds, its main numbers
            as `comparison.md`, and their growth as `comparison-minutes.png` and `-steps.png`.

    Raises:
        EverystateError: a term is out of range, an agent is unknown or not installed, the folder
            is of another comparison, or runs failed; those that did not are kept.
    """
    agents = list(dict.fromkeys(agents))
    contestants.require(agents)
    if not (1 <= seeds <= _MOST and 0 < terms.minutes <= _MOST):
        raise EverystateError(
            f"{seeds} seeds of {terms.minutes:g} minutes: choose from 1 to {_MOST:,} seeds, and"
            f" more than 0 and up to {_MOST:,} minutes"
        )
    preset(terms.preset, terms.body)
    suite = suites.load(terms.body)
    suite.subset(len(suite.goals) if terms.episodes is None else terms.episodes)
    _claim(folder, terms)
    cores: Queue[int] = Queue()
    for core in sorted(os.sched_getaffinity(0)):
        cores.put(core)

    def job(name: str, seed: int) -> str | None:
        core = cores.get()
        try:
            return _run(folder, name, seed, core)
        finally:
            cores.put(core)

    # Seed by seed, so that a comparison that is stopped has all agents with its first seeds.
    runs = [(name, seed) for seed in range(seeds) for name in agents]
    with ThreadPoolExecutor(cores.qsize()) as pool:
        problems = [p for p in pool.map(lambda run: job(*run), runs) if p]
    if problems:
        raise EverystateError(
            f"{len(problems)} of {len(runs)} runs failed; the same command tries them again."
            f" The first: {problems[0]}"
        )
    return write(folder, agents)


def write(folder: Path, agents: Sequence[str]) -> dict[str, Any]:
    """Everything over seeds, as files, from the results in the folder alone."""
    from everystate.viewing.figures import comparison

    groups = {name: sorted((folder / name).glob("seed*")) for name in agents}
    groups = {
        name: [run for run in found if (run / "evaluation.json").exists()]
        for name, found in groups.items()
    }
    result = gather(read_json(folder / "terms.json"), groups)
    write_atomically(folder / "comparison.json", json.dumps(result, indent=1) + "\n")
    write_atomically(folder / "comparison.md", table(result))
    grown = {n: [r for r in found if read_metrics(r)] for n, found in groups.items()}
    grown = {n: found for n, found in grown.items() if found}
    for over in ("minutes", "steps") if grown else ():
        comparison(grown, over=over).savefig(folder / f"comparison-{over}.png", dpi=150)
    return result


def gather(terms: Mapping[str, Any], groups: Mapping[str, Sequence[Path]]) -> dict[str, Any]:
    """Evaluations over seeds by agent, and success after as many steps as the slowest took."""
    read = {name: [read_json(run / "evaluation.json") for run in g] for name, g in groups.items()}
    taken = [one["steps"] for found in read.values() for one in found if one["steps"]]
    fewest = min(taken, default=0)
    agents = {}
    for name, found in read.items():
        agents[name] = over_seeds(found) | {
            "steps": summary([float(one["steps"]) for one in found]),
            "at_equal_steps": _summaries([_success_by(run, fewest) for run in groups[name]]),
        }
    return {**terms, "equal_steps": fewest, "agents": agents}


def _success_by(run: Path, steps: int) -> dict[str, float]:
    """Success@0.5 by region at the last look before so many steps; empty without any."""
    found: dict[str, float] = {}
    for line in read_metrics(run):
        looked = {n.rpartition("/")[2]: x for n, x in line.items() if n.startswith("eval/success@")}
        if looked and line["steps"] <= steps:
            found = looked
    return found


def _summaries(found: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    regions = dict.fromkeys(region for one in found for region in one)
    return {r: summary([one[r] for one in found if r in one]) for r in regions}


def _claim(folder: Path, terms: Terms) -> None:
    path, wanted = folder / "terms.json", json.loads(json.dumps(terms._asdict()))
    if path.exists():
        found = read_json(path)
        differing = [
            f"{n} {found.get(n)} there, {x} here" for n, x in wanted.items() if found.get(n) != x
        ]
        if differing:
            raise EverystateError(
                f"{folder} holds another comparison ({'; '.join(differing)}): choose another --out"
            )
        return
    if folder.exists() and any(folder.iterdir()):
        raise EverystateError(f"{folder} is not empty and no comparison: choose another --out")
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(path, json.dumps(wanted, indent=1) + "\n")


def _run(folder: Path, name: str, seed: int, core: int) -> str | None:
    """One run as a process of its own on one core; what went wrong, if anything."""
    if (folder / name / f"seed{seed}" / "evaluation.json").exists():
        return None
    command = [sys.executable, "-m", "everystate.peers", str(folder), name, str(seed)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    os.sched_setaffinity(process.pid, {core})
    _, said = process.communicate()
    if process.returncode == 130:
        raise KeyboardInterrupt
    if process.returncode:
        why = said.strip().splitlines() or [f"exit code {process.returncode}"]
        return f"{name} seed {seed}: {why[-1]}"
    print(f"{name} seed {seed}: in {folder / name / f'seed{seed}'}", flush=True)
    return None
