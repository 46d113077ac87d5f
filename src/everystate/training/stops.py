"""What may stop a run: Ctrl-C, and a disk that is full."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from everystate.errors import EverystateError


@contextmanager
def written() -> Iterator[None]:
    """What the disk refuses, as an error of ours."""
    try:
        yield
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        raise EverystateError(
            f"cannot write{where} ({error.strerror}): the last checkpoint is kept; once there is"
            f" room to write, the same command goes on from there"
        ) from error


@contextmanager
def interrupts() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed; the second time it does what it did before."""
    pressed = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield pressed.is_set  # Signals are the main thread's affair.
        return

    def first(*_: object) -> None:
        pressed.set()
        signal.signal(signal.SIGINT, previous)
        print("\nstopping as soon as the run can be saved; again to give up", file=sys.stderr)

    previous = signal.signal(signal.SIGINT, first)
    try:
        yield pressed.is_set
    finally:
        signal.signal(signal.SIGINT, previous)
