"""The metrics as TensorBoard reads them.

Written at once, unlike by tensorboardX's own writer: its thread dies of a full disk, and then
whoever hands it more waits for ever.
"""

import time
from collections.abc import Mapping
from pathlib import Path

from tensorboardX.event_file_writer import EventsWriter
from tensorboardX.proto.event_pb2 import Event, SessionLog  # pyright: ignore
from tensorboardX.proto.summary_pb2 import Summary  # pyright: ignore


class Board:
    """An event file. A context manager."""

    def __init__(self, folder: Path, done: int) -> None:
        """A new file, beside older ones of which all after epoch `done` is forgotten."""
        folder.mkdir(exist_ok=True)
        self._writer = EventsWriter(str(folder / "events"))
        self._write(Event(step=done + 1, session_log=SessionLog(status=SessionLog.START)))

    def epoch(self, epoch: int, metrics: Mapping[str, int | float]) -> None:
        """A point on every curve."""
        values = [
            Summary.Value(tag=name, simple_value=value)
            for name, value in metrics.items()
            if name != "epoch"
        ]
        self._write(Event(step=epoch, summary=Summary(value=values)))

    def __enter__(self) -> "Board":
        return self

    def __exit__(self, *error) -> None:
        self._writer.close()

    def _write(self, event: Event) -> None:
        event.wall_time = time.time()
        self._writer.write_event(event)
        self._writer.flush()
