"""Blocks of a comparison: all agents of one seed, one after the other on one core of one machine.

What differs between machines, or cores, or hours of the day, then differs between blocks and not
between agents. Blocks run beside one another, as many as there are cores.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue
from typing import Any, Literal

from everystate.agent.files import read_json
from everystate.errors import EverystateError
from everystate.evaluation import raw
from everystate.evaluation.provenance import provenance
from everystate.peers.contest import MEASURED

What = Literal["play", "replay"]


def run(folder: Path, agents: Sequence[str], seeds: Sequence[int], what: What) -> list[str]:
    """Plays or replays every agent with every seed; returns what went wrong with which.

    Raises:
        EverystateError: a block to play was begun on another machine.
    """
    if what == "play":
        machine = provenance()["machine"]
        for seed in seeds:
            if not all(_done(folder, name, seed) for name in agents):
                _claim(folder, seed, machine)
    cores: Queue[int] = Queue()
    for core in sorted(os.sched_getaffinity(0)):
        cores.put(core)

    def block(seed: int) -> list[str]:
        core = cores.get()
        try:
            return [p for name in agents if (p := _run(folder, name, seed, core, what))]
        finally:
            cores.put(core)

    with ThreadPoolExecutor(cores.qsize()) as pool:
        return [problem for problems in pool.map(block, seeds) for problem in problems]


def _run(folder: Path, name: str, seed: int, core: int, what: What) -> str | None:
    """One run as a process of its own on one core; what went wrong, if anything."""
    # Nothing is trained twice, nor measured again that never was.
    if _done(folder, name, seed) == (what == "play"):
        return None
    command = [sys.executable, "-m", "everystate.peers", str(folder), name, str(seed), what]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    os.sched_setaffinity(process.pid, {core})
    _, said = process.communicate()
    if process.returncode == 130:
        raise KeyboardInterrupt
    if process.returncode:
        why = said.strip().splitlines() or [f"exit code {process.returncode}"]
        return f"{name} seed {seed}: {why[-1]}"
    if what == "play":
        _record(folder, seed, name, core)
    print(f"{name} seed {seed}: in {folder / name / f'seed{seed}'}", flush=True)
    return None


def _done(folder: Path, name: str, seed: int) -> bool:
    return (folder / name / f"seed{seed}" / MEASURED).exists()


def _claim(folder: Path, seed: int, machine: dict[str, Any]) -> None:
    """A block for this machine."""
    path = _path(folder, seed)
    if not path.exists():
        path.parent.mkdir(exist_ok=True)
        _write(path, {"seed": seed, "machine": machine, "runs": []})
    elif (begun := read_json(path)["machine"]) != machine:
        raise EverystateError(
            f"the block of seed {seed} was begun on another machine ({begun} there, {machine}"
            f" here): go on there, or delete {path} and every seed{seed} in {folder}"
        )


def _record(folder: Path, seed: int, name: str, core: int) -> None:
    path = _path(folder, seed)
    found = read_json(path)
    found["runs"].append({"agent": name, "core": core})
    _write(path, found)


def _path(folder: Path, seed: int) -> Path:
    return folder / "blocks" / f"seed{seed}.json"


def _write(path: Path, block: dict[str, Any]) -> None:
    raw.write(path, block, replace=True)
