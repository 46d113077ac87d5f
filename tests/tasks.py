"""Runs of no agent, for tests of the pool: a process of its own imports them from here."""

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from everystate.errors import EverystateError
from everystate.studies.runs import finished


class Counting(NamedTuple):
    """Counts to `most`, and goes on from where it was; after the first it waits for `gate`."""

    most: int = 1
    gate: str | None = None

    def __call__(self, folder: Path, typed: Mapping[str, Any]) -> None:
        assert not finished(folder)
        count = folder / "count"
        while (done := int(count.read_text()) if count.exists() else 0) < self.most:
            while done and self.gate and not Path(self.gate).exists():
                time.sleep(0.05)
            with (folder / "by").open("a") as by:
                by.write(f"{os.getpid()} {sorted(os.sched_getaffinity(0))}\n")
            draft = folder / ".draft"
            draft.write_text(f"{done + 1}")
            os.replace(draft, count)
        (folder / "evaluation.json").write_text("{}")


class Failing(NamedTuple):
    """Fails in one of three ways."""

    how: str

    def __call__(self, folder: Path, typed: Mapping[str, Any]) -> None:
        if self.how == "told":
            raise EverystateError("mend this,\nplease")
        if self.how == "killed":
            os.kill(os.getpid(), 9)
        raise ValueError("not foreseen")
