"""A pool of workers for the runs of a study: here, or on a Ray cluster.

Every run has a process of its own, which keeps to one core. A worker takes one block of runs at a
time and makes them one after the other on the same core: what differs between cores, machines or
hours of the day then differs between blocks and not within them.
"""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event
from typing import Any

from everystate import locks
from everystate.errors import EverystateError
from everystate.evaluation.provenance import argv, command, usable_cores
from everystate.studies.runs import Run

_MOST_ON_RAY = 128
"""Blocks that a cluster is asked for at a time; it makes as many as it has cores."""

Block = Sequence[Run]
Say = Callable[[str], None]


class Pool:
    """Makes blocks of runs; `opened` gives one."""

    def __init__(self, out: Path, size: int, make: Callable[..., list[str]]) -> None:
        self.size = size
        self.stopped = Event()
        self._out, self._make = out.resolve(), make
        self._typed = {"command": command(), "argv": argv()}
        self._threads = ThreadPoolExecutor(size)

    def submit(self, block: Block) -> Future[list[str]]:
        """Returns at once; the result is a line for each of its runs that failed."""
        return self._threads.submit(self._make, block, self._out, self._typed, self.stopped, _say)

    def close(self, *, stop: bool) -> None:
        """Waits for what is being made; with `stop` that is interrupted, and the rest left."""
        if stop:
            self.stopped.set()
        self._threads.shutdown(cancel_futures=stop)


@contextmanager
def opened(out: Path, workers: int | None = None, address: str | None = None) -> Iterator[Pool]:
    """A pool, for as long as it is needed. Ctrl-C saves the runs that are being made.

    Args:
        out: the study's folder.
        workers: how many blocks are made at a time, by default as many as there are cores.
        address: of a Ray cluster to make them on, HOST:PORT or auto; None is this machine.

    Raises:
        EverystateError: `workers` is below 1; or there is no such cluster, or no Ray.
    """
    if workers is not None and workers < 1:
        raise EverystateError(f"workers = {workers}: choose 1 or more")
    if address is None:
        pool = Pool(out, workers or len(usable_cores()), make_block)
        with _closing(pool):
            yield pool
        return
    from everystate.scaling.cluster import connected, elsewhere

    def make(block: Block, out: Path, typed: Any, stopped: Event, say: Say) -> list[str]:
        problems = elsewhere(make_block, block, out, typed, stopped=stopped)
        _tell(block, problems, say)
        return problems

    with connected(address, 0):
        pool = Pool(out, workers or _MOST_ON_RAY, make)
        with _closing(pool):
            yield pool


@contextmanager
def _closing(pool: Pool) -> Iterator[None]:
    try:
        yield
    except BaseException:
        pool.close(stop=True)
        raise
    pool.close(stop=False)


def run_all(
    blocks: Sequence[Block], out: Path, *, workers: int | None = None, address: str | None = None
) -> list[str]:
    """Makes all runs, block by block; returns a line for each that failed. See `opened`."""
    if not any(blocks):
        return []
    with opened(out, workers, address) as pool:
        made = [pool.submit(block) for block in blocks]
        for future in as_completed(made):
            future.result()
        return [problem for future in made for problem in future.result()]


def complain(problems: Sequence[str]) -> None:
    """Raises an `EverystateError` if runs failed."""
    if problems:
        raise EverystateError(
            f"{len(problems)} runs failed; the same command tries them again."
            f" The first: {problems[0]}"
        )


def make_block(
    block: Block,
    out: Path,
    typed: Mapping[str, Any],
    stopped: Event | None = None,
    say: Say = lambda line: None,
) -> list[str]:
    """Makes runs one after the other on one core; returns a line for each that failed.

    Args:
        block: the runs.
        out: the study's folder.
        typed: see `Task`.
        stopped: once it is set, the run that is being made is interrupted, and no other begins.
        say: is given a line for each run that has ended.
    """
    stopped, problems = stopped or Event(), []
    with one_core() as core:
        for run in block:
            problem = None if stopped.is_set() else _make(run, out, core, typed, stopped)
            if stopped.is_set():
                raise KeyboardInterrupt
            found = [f"{run.name}: {problem}"] if problem else []
            _tell([run], found, say)
            problems += found
    return problems


def _make(
    run: Run, out: Path, core: int | None, typed: Mapping[str, Any], stopped: Event
) -> str | None:
    """One run in its process; what went wrong, if anything. `log.txt` is kept of what failed."""
    folder = out / run.name
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "log.txt"
    with log.open("w") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "everystate.studies"],
            stdin=subprocess.PIPE,
            stdout=said,
            stderr=said,
            start_new_session=True,  # Ctrl-C comes from here, once: a second one gives up
        )
    assert process.stdin is not None
    with suppress(OSError):  # if it has ended already, its log says why
        if core is not None:
            os.sched_setaffinity(process.pid, {core})
        pickle.dump((run.task, folder, dict(typed)), process.stdin)
        process.stdin.flush()
    asked = False
    while True:
        try:
            process.wait(0.2)
            break
        except subprocess.TimeoutExpired:
            if stopped.is_set() and not asked:
                process.send_signal(signal.SIGINT)
                asked = True
    with suppress(OSError):
        process.stdin.close()  # not before: it would end
    if process.returncode == 0:
        log.unlink()
        return None
    lines = log.read_text(errors="replace").split("\n")
    last = next((line.strip() for line in reversed(lines) if line.strip()), "")
    return last if process.returncode > 0 and last else f"exit code {process.returncode}"


def _tell(block: Block, problems: Sequence[str], say: Say) -> None:
    failed = {line.partition(": ")[0]: line for line in problems}
    for run in block:
        say(failed.get(run.name, f"{run.name}: done"))


def _say(line: str) -> None:
    print(line, flush=True)


@contextmanager
def one_core() -> Iterator[int | None]:
    """A core that no other run on this machine has; None if all have one, or it cannot be chosen.

    Runs that share cores wait for each other at every step. The system gives a core up again when
    this process ends, however it ends.
    """
    folder = Path(tempfile.gettempdir()) / f"everystate-cores-{getattr(os, 'getuid', str)()}"
    folder.mkdir(exist_ok=True)
    for core in usable_cores() if hasattr(os, "sched_setaffinity") else ():
        with (folder / str(core)).open("w") as lock:
            try:
                locks.lock(lock)
            except BlockingIOError:
                continue
            yield core
        return
    yield None
