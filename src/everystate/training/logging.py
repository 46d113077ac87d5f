"""What a run says of itself: metrics.jsonl, TensorBoard, and a progress bar or plain lines."""

import functools
import itertools
import json
import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from everystate.agent.json_files import read_lines
from everystate.training.rundir import write_atomically

Show = Literal["bar", "plain", "nothing"]
OnEpoch = Callable[[Mapping[str, int | float]], bool | None]
"""What is called with each epoch's metrics; False ends the run."""
_PLAIN_LINES = 20  # About how many a whole run prints.


def read_metrics(folder: Path) -> list[dict[str, int | float]]:
    """The epochs of a run's metrics.jsonl; what was cut short or damaged ends them."""
    lines = read_lines(folder / "metrics.jsonl")
    sound = ("epoch" in line and _are_numbers(line) for line in lines)
    return [line for line, _ in zip(lines, itertools.takewhile(bool, sound), strict=False)]


def _are_numbers(line: Mapping[str, object]) -> bool:
    return all(isinstance(value, (int, float)) for value in line.values())


class Log:
    """Writes an epoch's metrics wherever they are wanted. A context manager.

    On resuming, what was logged after the checkpoint is dropped, so that the files are those of an
    uninterrupted run, times apart.
    """

    def __init__(
        self,
        folder: Path,
        *,
        done: int,
        epochs: int,
        show: Show,
        on_epoch: OnEpoch | None = None,
    ) -> None:
        """`done` of `epochs` epochs lie behind; `show` says what appears on the screen."""
        kept = [line for line in read_metrics(folder) if line["epoch"] <= done]
        text = "".join(json.dumps(line) + "\n" for line in kept)
        write_atomically(folder / "metrics.jsonl", text)
        self.elapsed_before = kept[-1].get("time/elapsed_s", 0.0) if kept else 0.0
        self._epochs, self._done, self._show = epochs, done, show
        self._on_epoch = on_epoch
        self._file = (folder / "metrics.jsonl").open("a", buffering=1)
        self._folder = folder
        self._bar = Progress(
            TextColumn("epoch {task.completed:.0f}/{task.total:.0f}"),
            BarColumn(),
            TextColumn("{task.fields[status]}"),
            TimeRemainingColumn(),
            disable=show != "bar",
        )
        self._task = self._bar.add_task("", total=epochs, completed=done, status="compiling")

    def __enter__(self) -> "Log":
        with ExitStack() as stack:
            stack.enter_context(self._file)
            stack.enter_context(self._bar)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error) -> None:
        self._stack.close()

    def epoch(self, metrics: Mapping[str, int | float]) -> bool:
        """Logs one epoch, and returns whether to go on.

        `metrics` has `epoch` and `steps` among its names.
        """
        self._file.write(json.dumps(metrics, allow_nan=False) + "\n")
        epoch = int(metrics["epoch"])
        self._board.epoch(epoch, metrics)
        status = (
            f"{int(metrics['steps']):,} steps, {metrics['time/updates_per_s']:.0f} updates/s, "
            f"{100 * metrics['episode/reached']:.0f} % of goals reached"
        )
        self._bar.update(self._task, completed=epoch, status=status)
        every = max(1, self._epochs // _PLAIN_LINES)
        if self._show == "plain" and (epoch % every == 0 or epoch == self._epochs):
            print(f"epoch {epoch}/{self._epochs}: {status}", flush=True)
        said = self._on_epoch(metrics) if self._on_epoch else None
        return said is None or bool(said)

    @functools.cached_property
    def _board(self) -> Any:
        # Not before it is needed: it imports PyTorch wherever that is installed, for seconds.
        from everystate.training.tensorboard import Board

        return self._stack.enter_context(Board(self._folder / "tensorboard", self._done))

    def say(self, message: str) -> None:
        """A line for whoever watches."""
        if self._show == "bar":
            self._bar.console.print(message, highlight=False, markup=False, soft_wrap=True)
        elif self._show == "plain":
            print(message, flush=True)


def shown(progress: bool | Literal["plain"]) -> Show:
    """What to show: a bar only where there is a screen to draw it on."""
    if progress is False:
        return "nothing"
    return "bar" if progress is True and sys.stdout.isatty() else "plain"
