"""Says that something takes its time, how far it is, and how long it will take: on stderr."""

import contextlib
from collections.abc import Callable, Iterator
from time import monotonic

Count = Callable[[int, int, float], None]
PERIOD = 30.0
"""Seconds between plain lines, where there is no terminal to draw a bar on."""


@contextlib.contextmanager
def working(what: str) -> Iterator[Count]:
    """While it lasts there is a bar on a terminal, and elsewhere a plain line now and then.

    What it gives is called with the steps done, all there are, and the share of the work done.
    """
    from rich import progress  # here, so that a command's help does not wait for it
    from rich.console import Console

    console = Console(stderr=True)
    says = progress.TextColumn
    columns = progress.SpinnerColumn(), says("{task.description}"), progress.BarColumn()
    left, spent = progress.TimeRemainingColumn(), progress.TimeElapsedColumn()
    said, first = monotonic(), None  # the first step compiles, which tells nothing of the others
    with progress.Progress(
        *(*columns, says("left"), left, says("so far"), spent),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task(what, total=None)

        def count(done: int, steps: int, share: float) -> None:
            nonlocal said, first
            text, now = f"{what}, step {done:,} of {steps:,}", monotonic()
            bar.update(task, total=1.0, completed=share, description=text)
            if not console.is_terminal and now - said > PERIOD:
                said = now
                if first and share > first[1]:
                    left = (now - first[0]) * (1 - share) / (share - first[1])
                    text += f", about {_lasting(left)} left"
                console.print(text, highlight=False)
            first = first or (now, share)

        yield count


def _lasting(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
