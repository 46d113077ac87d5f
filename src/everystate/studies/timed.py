"""One agent of a comparison: trained for a time, measured, and its results written.

Its folder gets `evaluation.json`, which says that it is done, and `metrics.jsonl`, how it came
about; `acting/` has what it needs to act again, and our agent's run is in `run/`.
"""

import hashlib
import json
import os
import shutil
import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Timer
from typing import Any, NamedTuple, get_args

import numpy as np

from everystate import evaluation, training
from everystate.agent import load
from everystate.agent.json_files import read_json
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.evaluation import raw, suites
from everystate.evaluation.agents import Agent
from everystate.evaluation.provenance import usable_cores
from everystate.peers import acting
from everystate.peers.agents import PeerConfig
from everystate.peers.settings import PeerSettings
from everystate.presets import preset
from everystate.skills import SKILLS
from everystate.studies.agents import AGENTS
from everystate.studies.runs import MEASURED, finished
from everystate.training import coverage
from everystate.training.logging import read_metrics
from everystate.training.rundir import write_atomically

RESCORED = "rescored.json"

_PERIOD = 10
"""Epochs between evaluations during the training of ours."""
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


class Timed(NamedTuple):
    """A task: an agent, trained for some minutes and then measured.

    What is measured is what is kept of it, so that `Rescoring` measures the same agent.
    """

    agent: str
    seed: int
    terms: Terms

    def __call__(self, folder: Path, typed: Mapping[str, Any]) -> None:
        if finished(folder):
            return
        folder.mkdir(parents=True, exist_ok=True)
        for split in get_args(suites.Split):  # what is made on the spot takes no agent's time
            suites.every(self.terms.body, split=split)
        kept = folder / "acting"
        shutil.rmtree(kept, ignore_errors=True)  # of a run that was stopped while it was measured
        agent, lines = self._made(folder / "run", kept)
        cells = [line["coverage/cells"] for line in lines if "coverage/cells" in line]
        result = self.measure(agent) | {
            "steps": lines[-1]["steps"] if lines else 0,
            "coverage": {"cells": cells[-1]} if cells else None,
            "acting": acting.checksums(kept),
        }
        logged = [{n: x for n, x in line.items() if n.startswith(_LOGGED)} for line in lines]
        text = "".join(json.dumps(line) + "\n" for line in logged)
        write_atomically(folder / "metrics.jsonl", text)
        result["metrics"] = hashlib.sha256(text.encode()).hexdigest()
        raw.write(folder / MEASURED, {**result, **typed})

    def _made(self, run: Path, kept: Path) -> tuple[Agent, list[dict[str, Any]]]:
        how, seconds = AGENTS[self.agent], 60 * self.terms.minutes
        if how.options is not None:
            options = {"evaluation_period": _PERIOD, **how.options}
            config = preset(self.terms.preset, self.terms.body, seed=self.seed, **options)
            return _ours(config, seconds, run, kept)
        config = PeerConfig(self.terms.body, (), self.seed, self.agent, {})
        if how.settings is not None:
            return _peer(config, seconds, how.settings, kept)
        return acting.load(kept, config), []

    def measure(self, agent: Agent) -> dict[str, Any]:
        """The same for all agents."""
        result = evaluation.evaluate(
            agent,
            plan=self.terms.plan and AGENTS[self.agent].options is not None,
            episodes=self.terms.episodes,
            skills=self.terms.body in SKILLS,
        )
        cores = usable_cores()
        return result | {"agent": self.agent, "minutes": self.terms.minutes, "cores": cores}


class Rescoring(NamedTuple):
    """A task: what was kept of an agent is measured again, without training."""

    of: Timed

    def __call__(self, folder: Path, typed: Mapping[str, Any]) -> None:
        """Makes the run.

        Raises:
            EverystateError: nothing is kept of it, or not what was measured.
        """
        kept, before = folder / "acting", read_json(folder / MEASURED)
        agent = acting.load(
            kept, PeerConfig(self.of.terms.body, (), self.of.seed, self.of.agent, {})
        )
        found = acting.checksums(kept)
        if found != before["acting"]:
            raise EverystateError(
                f"{kept} is not what {folder / MEASURED} measured: train it again"
            )
        same = {name: before[name] for name in ("steps", "coverage", "acting", "metrics")}
        raw.write(folder / RESCORED, {**self.of.measure(agent), **same, **typed}, replace=True)


def _ours(
    config: Config, seconds: float, run: Path, kept: Path
) -> tuple[Agent, list[dict[str, Any]]]:
    """Our agent, stopped as Ctrl-C does when its time is over."""
    before = read_metrics(run)
    left = seconds - (before[-1]["time/elapsed_s"] if before else 0)
    if left > 0:
        with interrupted_after(left):
            training.train(config, run_dir=run, progress=False)
    load(run).export(kept, half=True)
    return load(kept), read_metrics(run)


@contextmanager
def interrupted_after(seconds: float) -> Iterator[None]:
    """Ends what it surrounds by an interrupt when this time is over."""
    over = False

    def ring() -> None:
        nonlocal over
        over = True
        os.kill(os.getpid(), signal.SIGINT)

    timer = Timer(seconds, ring)
    timer.start()
    try:
        yield
    except KeyboardInterrupt:
        if not over:
            raise
    finally:
        timer.cancel()


def _peer(
    config: PeerConfig, seconds: float, settings: PeerSettings, kept: Path
) -> tuple[Agent, list[dict[str, Any]]]:
    from everystate.peers.hindsight import HindsightAgent

    agent = HindsightAgent(config.body, config.seed, config.agent, settings)
    box = agent.env.body.single_observation_space
    cells = coverage.no_cells(box.low, box.high)
    lines: list[dict[str, Any]] = []

    def visit(states: np.ndarray) -> None:
        nonlocal cells
        cells = coverage.visit(cells, states, box.low, box.high)

    def look(steps: int, elapsed: float) -> None:
        found = evaluation.logged(agent)
        line = {"epoch": len(lines) + 1, "steps": steps, "time/elapsed_s": elapsed} | found
        lines.append(line | ({"coverage/cells": float(cells.mean())} if cells.size else {}))

    agent.env.watch(visit)
    agent.learn(seconds, look, period=max(seconds / _LOOKS, _LEAST))
    return agent.keep(kept), lines
