"""The pool of a study: processes and cores of their own, failures, kills at any moment."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from everystate.errors import EverystateError
from everystate.studies import pool, run_all
from everystate.studies.runs import Run, finished
from tasks import Counting, Failing
from waiting import until

TESTS = Path(__file__).parent
DRIVER = """
import signal
import sys
from pathlib import Path
from everystate.studies import Run, run_all
from everystate.studies.runs import finished
from tasks import Counting
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background of a script
out = Path(sys.argv[1])
runs = [Run(f"all/seed{i}", Counting(20, str(out / "gate"))) for i in range(2)]
left = [[run] for run in runs if not finished(out / run.name)]
sys.exit(len(run_all(left, out, workers=2)))
"""


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Of the tests' own tasks; and cores that no study outside has taken."""
    path = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
    monkeypatch.setenv("PYTHONPATH", path)
    monkeypatch.setattr(pool.tempfile, "gettempdir", lambda: str(tmp_path))


def by(folder: Path) -> list[list[str]]:
    return [line.split(" ", 1) for line in (folder / "by").read_text().splitlines()]


def test_a_block_is_made_on_one_core_each_run_in_its_own_process(tmp_path: Path) -> None:
    block = [Run(f"{name}/seed0", Counting()) for name in "ab"]
    assert run_all([block], tmp_path, workers=1) == []
    first, second = (by(tmp_path / run.name)[0] for run in block)
    assert first[0] != second[0]
    assert first[1] == second[1] == str(sorted(os.sched_getaffinity(0))[:1])
    assert all(finished(tmp_path / run.name) for run in block)
    assert not list(tmp_path.glob("*/*/log.txt"))


def test_a_failed_run_is_a_line_and_the_others_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [Run(f"{how}/seed0", Failing(how)) for how in ("told", "killed", "unforeseen")]
    problems = run_all([[*runs, Run("good/seed0", Counting())]], tmp_path, workers=1)
    assert problems == [
        "told/seed0: error: mend this, please",
        "killed/seed0: exit code -9",
        "unforeseen/seed0: ValueError: not foreseen",
    ]
    assert capsys.readouterr().out.splitlines() == [*problems, "good/seed0: done"]
    assert "Traceback" in (tmp_path / "unforeseen/seed0/log.txt").read_text()
    with pytest.raises(EverystateError, match="3 runs failed"):
        pool.complain(problems)
    with pytest.raises(EverystateError, match="workers = 0"):
        run_all([runs], tmp_path, workers=0)


def driver(out: Path, **how: Any) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", DRIVER, str(out)], text=True, **how)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_study_that_is_stopped_goes_on_by_the_same_command(tmp_path: Path, how: int) -> None:
    study = driver(tmp_path, stderr=subprocess.DEVNULL)
    counts = [tmp_path / f"all/seed{i}/count" for i in range(2)]
    until(lambda: all(count.exists() for count in counts), 300)
    study.send_signal(how)
    assert study.wait(300) != 0
    made = {int(pid) for count in counts for pid, _ in by(count.parent)}
    until(lambda: not any(map(alive, made)))  # no run outlives its study
    assert not any(finished(count.parent) for count in counts)
    (tmp_path / "gate").touch()
    again = driver(tmp_path)
    assert again.wait(300) == 0
    for count in counts:
        assert len(by(count.parent)) == 20  # nothing was done twice
        assert finished(count.parent)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_runs_keep_to_cores_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool.os, "sched_getaffinity", lambda _: {0, 1})
    with pool.one_core() as first, pool.one_core() as second, pool.one_core() as third:
        assert (first, second, third) == (0, 1, None)
    with pool.one_core() as again:
        assert again == 0


def test_where_a_system_does_not_say_which_cores_there_are_all_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As on macOS, where none can be chosen either."""
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.delattr(os, "sched_setaffinity")
    assert pool.usable_cores() == list(range(os.cpu_count() or 1))
    with pool.one_core() as core:
        assert core is None
