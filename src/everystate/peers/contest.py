"""One agent of a comparison: trained for a time, measured, and its results written.

Its folder gets `evaluation.json`, which says that it is done, and `metrics.jsonl`, how it came
about; `acting/` has what it needs to act again, and our agent's run is in `run/`.
"""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from everystate import evaluation
from everystate.agent import load
from everystate.agent.files import read_json
from everystate.errors import EverystateError
from everystate.evaluation import raw
from everystate.evaluation.agents import Agent
from everystate.peers import acting
from everystate.peers.agents import PeerConfig
from everystate.peers.contestants import CONTESTANTS
from everystate.peers.settings import PeerSettings
from everystate.skills import SKILLS
from everystate.training import coverage
from everystate.training.logging import read_metrics
from everystate.training.rundir import write_atomically

MEASURED, RESCORED = "evaluation.json", "rescored.json"

_LOOKS, _LEAST = 20, 15.0
"""Evaluations during the training of a peer, and the seconds that at least lie between them."""
_LOGGED = ("epoch", "steps", "time/elapsed_s", "coverage/", "eval/")


class Terms(NamedTuple):
    """What is the same for all agents of a comparison."""

    body: str
    minutes: float
    preset: str
    episodes: int | None
    plan: bool
    options: tuple[str, ...] = ()
    """Further options of `everystate train`, for our agents alone."""


def play(name: str, seed: int, terms: Terms, folder: Path) -> None:
    """Trains and measures one agent, unless its results are there already.

    What is measured is what is kept of it, so that `replay` measures the same agent.
    """
    if (folder / MEASURED).exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / "acting"
    shutil.rmtree(kept, ignore_errors=True)  # of a run that was stopped while it was measured
    contestant = CONTESTANTS[name]
    if contestant.options is not None:
        agent, lines = _ours(seed, terms, contestant.options, folder / "run", kept)
    elif contestant.settings is not None:
        agent, lines = _peer(name, seed, terms, contestant.settings, kept)
    else:
        agent, lines = acting.load(kept, PeerConfig(terms.body, (), seed, name, {})), []
    cells = [line["coverage/cells"] for line in lines if "coverage/cells" in line]
    result = _measure(agent, name, terms) | {
        "steps": lines[-1]["steps"] if lines else 0,
        "coverage": {"cells": cells[-1]} if cells else None,
        "acting": acting.checksums(kept),
    }
    logged = [{n: x for n, x in line.items() if n.startswith(_LOGGED)} for line in lines]
    text = "".join(json.dumps(line) + "\n" for line in logged)
    write_atomically(folder / "metrics.jsonl", text)
    result["metrics"] = hashlib.sha256(text.encode()).hexdigest()
    raw.write(folder / MEASURED, result)


def replay(name: str, seed: int, terms: Terms, folder: Path) -> None:
    """Measures again what is kept of an agent, without training.

    Raises:
        EverystateError: nothing is kept of it, or not what was measured.
    """
    kept, before = folder / "acting", read_json(folder / MEASURED)
    agent = acting.load(kept, PeerConfig(terms.body, (), seed, name, {}))
    found = acting.checksums(kept)
    if found != before["acting"]:
        raise EverystateError(f"{kept} is not what {folder / MEASURED} measured: train it again")
    same = {name: before[name] for name in ("steps", "coverage", "acting", "metrics")}
    raw.write(folder / RESCORED, _measure(agent, name, terms) | same, replace=True)


def _measure(agent: Agent, name: str, terms: Terms) -> dict[str, Any]:
    result = evaluation.evaluate(
        agent,
        plan=terms.plan and CONTESTANTS[name].options is not None,
        episodes=terms.episodes,
        skills=terms.body in SKILLS,
    )
    cores = sorted(os.sched_getaffinity(0))
    return result | {"agent": name, "minutes": terms.minutes, "cores": cores}


def _ours(
    seed: int, terms: Terms, options: tuple[str, ...], run: Path, kept: Path
) -> tuple[Agent, list[dict[str, Any]]]:
    """Our agent by its own command, stopped as Ctrl-C does when its time is over."""
    before = read_metrics(run)
    left = 60 * terms.minutes - (before[-1]["time/elapsed_s"] if before else 0)
    if left > 0:
        _train(seed, terms, options, run, left)
    load(run).export(kept, half=True)
    return load(kept), read_metrics(run)


def _train(seed: int, terms: Terms, options: tuple[str, ...], run: Path, seconds: float) -> None:
    words = ["train", terms.body, "--preset", terms.preset, "--seed", str(seed), "--quiet"]
    words += ["--evaluation-period", "10", "--run-dir", str(run), *options, *terms.options]
    process = subprocess.Popen(
        [sys.executable, "-m", "everystate", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        _, said = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
        process.communicate()
        return  # However it ended: what it has learned is in the run.
    if process.returncode == 130:
        raise KeyboardInterrupt
    if process.returncode:
        raise EverystateError(f"everystate {' '.join(words)} ended with: {said.strip()}")


def _peer(
    name: str, seed: int, terms: Terms, settings: PeerSettings, kept: Path
) -> tuple[Agent, list[dict[str, Any]]]:
    from everystate.peers.hindsight import HindsightAgent

    agent = HindsightAgent(terms.body, seed, name, settings)
    box = agent.env.body.single_observation_space
    cells = coverage.no_cells(box.low, box.high)
    lines: list[dict[str, Any]] = []

    def visit(states: np.ndarray) -> None:
        nonlocal cells
        cells = coverage.visit(cells, states, box.low, box.high)

    def look(steps: int, seconds: float) -> None:
        found = evaluation.logged(agent)
        line = {"epoch": len(lines) + 1, "steps": steps, "time/elapsed_s": seconds} | found
        lines.append(line | ({"coverage/cells": float(cells.mean())} if cells.size else {}))

    agent.env.watch(visit)
    seconds = 60 * terms.minutes
    agent.learn(seconds, look, period=max(seconds / _LOOKS, _LEAST))
    return agent.keep(kept), lines
