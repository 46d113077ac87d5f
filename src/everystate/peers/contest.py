"""One agent of a comparison: trained for a time, measured, and its results written.

Its folder gets `evaluation.json`, which says that it is done, and `metrics.jsonl`, how it came
about; our agent's run is in `run/`.
"""

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from everystate import evaluation
from everystate.agent import load
from everystate.errors import EverystateError
from everystate.evaluation.agents import Agent
from everystate.peers.agents import PeerConfig, RandomActions
from everystate.peers.contestants import CONTESTANTS
from everystate.skills import SKILLS
from everystate.training import coverage
from everystate.training.logging import read_metrics
from everystate.training.rundir import write_atomically

_LOOKS, _LEAST = 20, 15.0
"""Evaluations during the training of a peer, and the seconds that at least lie between them."""
_KEPT = ("epoch", "steps", "time/elapsed_s", "coverage/", "eval/")


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
    """Trains and measures one agent, unless its results are there already."""
    if (folder / "evaluation.json").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    options = CONTESTANTS[name].options
    if options is not None:
        agent, lines = _ours(seed, terms, options, folder / "run")
    elif name == "random":
        agent, lines = RandomActions(PeerConfig(terms.body, (), seed, name, {})), []
    else:
        agent, lines = _peer(name, seed, terms)
    result = evaluation.evaluate(
        agent,
        plan=terms.plan and options is not None,
        episodes=terms.episodes,
        skills=terms.body in SKILLS,
    )
    cells = [line["coverage/cells"] for line in lines if "coverage/cells" in line]
    result |= {
        "agent": name,
        "minutes": terms.minutes,
        "steps": lines[-1]["steps"] if lines else 0,
        "coverage": {"cells": cells[-1]} if cells else None,
    }
    kept = [{n: x for n, x in line.items() if n.startswith(_KEPT)} for line in lines]
    text = "".join(json.dumps(line) + "\n" for line in kept)
    write_atomically(folder / "metrics.jsonl", text)
    write_atomically(folder / "evaluation.json", json.dumps(result, indent=1) + "\n")


def _ours(
    seed: int, terms: Terms, options: tuple[str, ...], run: Path
) -> tuple[Agent, list[dict[str, Any]]]:
    """Our agent by its own command, stopped as Ctrl-C does when its time is over."""
    before = read_metrics(run)
    left = 60 * terms.minutes - (before[-1]["time/elapsed_s"] if before else 0)
    if left > 0:
        _train(seed, terms, options, run, left)
    return load(run), read_metrics(run)


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


def _peer(name: str, seed: int, terms: Terms) -> tuple[Agent, list[dict[str, Any]]]:
    from everystate.peers.hindsight import SETTINGS, HindsightAgent

    agent = HindsightAgent(PeerConfig(terms.body, (), seed, name, SETTINGS))
    body = agent.env.body
    box = body.single_observation_space
    cells = coverage.no_cells(box.low, box.high)
    lines: list[dict[str, Any]] = []

    def visit(states: np.ndarray) -> None:
        nonlocal cells
        cells = coverage.visit(cells, states, box.low, box.high)

    def look(steps: int, seconds: float) -> None:
        success = evaluation.evaluate(agent, plan=False)["success"]
        found = {f"eval/success@0.5/{n}": region["0.5"]["last"] for n, region in success.items()}
        line = {"epoch": len(lines) + 1, "steps": steps, "time/elapsed_s": seconds} | found
        lines.append(line | ({"coverage/cells": float(cells.mean())} if cells.size else {}))

    agent.env.watch(visit)
    seconds = 60 * terms.minutes
    agent.learn(seconds, look, period=max(seconds / _LOOKS, _LEAST))
    return agent, lines
