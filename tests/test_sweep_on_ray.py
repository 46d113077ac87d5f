"""Studies on a Ray cluster."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from test_sweep import CONDITIONS, SMALL, write
from waiting import until

pytestmark = [
    pytest.mark.scale,
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore:os.fork:RuntimeWarning"),  # as in scaling/cluster.py
]
SHORT = SMALL.replace("seeds = 2", "seeds = 1").replace("epochs = 2", "epochs = 1")
LONGER = SHORT.replace("epochs = 1", "epochs = 12")


def command(path: Path, out: Path, *more: str) -> list[str]:
    words = ["sweep", str(path), "--out", str(out), *more]
    return [sys.executable, "-m", "everystate", *words]


def sweep(path: Path, out: Path, *more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(path, out, *more), capture_output=True, text=True)


def evaluations(out: Path) -> dict[str, str]:
    """Of every finished run, what does not depend on the clock."""
    found = {}
    for path in sorted(out.glob("*/**/evaluation.json")):
        result = json.loads(path.read_text())
        found[str(path.parent.relative_to(out))] = json.dumps([result["suites"], result["config"]])
    return found


def test_a_cluster_that_is_not_there_is_told(tmp_path: Path) -> None:
    failed = sweep(write(tmp_path, SMALL), tmp_path / "out", "--ray-address", "127.0.0.1:1")
    assert failed.returncode == 2
    assert "no Ray cluster answers at 127.0.0.1:1" in failed.stderr


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("RAY_worker_niceness", "0")
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    yield made
    made.shutdown()


def test_a_failing_run_is_told_and_the_others_finish(tmp_path: Path, cluster: Any) -> None:
    path, out = write(tmp_path, SHORT + CONDITIONS), tmp_path / "out"
    foreign = out / "no-curriculum/seed0/run/mine.txt"
    foreign.parent.mkdir(parents=True)
    foreign.write_text("not a run")
    cluster.add_node(num_cpus=2)
    failed = sweep(path, out, "--ray-address", cluster.address)
    assert failed.returncode == 2
    assert "1 runs failed; the same command tries them again" in failed.stderr
    assert "is not empty and is no run" in failed.stderr
    assert "as-it-is/seed0: done" in failed.stdout
    (finished,) = out.glob("*/seed0/evaluation.json")
    assert json.loads(finished.read_text())["command"].startswith("everystate sweep ")


def test_runs_of_a_lost_node_go_on_on_another(tmp_path: Path, cluster: Any) -> None:
    path, out = write(tmp_path, LONGER), tmp_path / "out"
    lost = cluster.add_node(num_cpus=1)
    driver = subprocess.Popen(command(path, out, "--ray-address", cluster.address))
    run = out / "all/seed0/run/checkpoints"
    until(lambda: any(run.glob("[0-9]*")), 300)
    cluster.add_node(num_cpus=1)
    cluster.remove_node(lost, allow_graceful=False)
    assert driver.wait() == 0
    assert len(evaluations(out)) == 1
