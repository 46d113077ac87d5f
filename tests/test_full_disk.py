"""What the disk refuses is one clear line, the last checkpoint stays, and the run goes on later.

A limit on the size of a file stands for a full disk: no rights are needed to set it.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from everystate.agent import BodyInfo
from everystate.errors import EverystateError
from everystate.presets import preset
from everystate.training import train
from everystate.training.logging import read_metrics
from everystate.training.rundir import open_run

COMMAND = "-m everystate train ramp-pointmass --preset test --checkpoint-period 1 --quiet"


def run(folder: Path, limit: str) -> subprocess.CompletedProcess[str]:
    """The command, whose files may have `limit` KiB."""
    limited = ["bash", "-c", 'ulimit -f "$0"; exec "$@"', limit]
    command = [sys.executable, *COMMAND.split(), "--run-dir", str(folder)]
    return subprocess.run([*limited, *command], capture_output=True, text=True, timeout=300)


def test_a_full_disk_is_said_and_costs_nothing_that_was_kept(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    for limit, problem in (("20", "checkpoint"), ("1", "cannot write")):
        refused = run(folder, limit)
        assert refused.returncode == 2, refused.stderr
        assert problem in refused.stderr.splitlines()[-1]
        assert "the same command goes on from there" in refused.stderr
        assert "Traceback" not in refused.stderr
    assert not list((folder / "checkpoints").glob("*/"))
    done = run(folder, "unlimited")
    assert done.returncode == 0, done.stderr
    assert [line["epoch"] for line in read_metrics(folder)] == [1, 2, 3]


def test_a_folder_that_cannot_be_written_is_said_before_any_work() -> None:
    with pytest.raises(EverystateError, match="cannot write to /proc/everystate"):
        train("ramp-pointmass", preset="test", run_dir="/proc/everystate", progress=False)


def test_a_run_whose_lock_cannot_be_had_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text("{}")
    (tmp_path / ".lock").mkdir()
    with (
        pytest.raises(EverystateError, match="cannot write to"),
        open_run(tmp_path, preset("test"), BodyInfo(("x", "y"), 2)),
    ):
        pass
