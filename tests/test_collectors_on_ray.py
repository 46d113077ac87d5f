"""Collectors that are actors of Ray: processes, nodes and drivers that die change nothing."""

import functools
import gc
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import safetensors

from everystate import scaling
from everystate.errors import EverystateError
from everystate.scaling import collectors as on_cluster
from everystate.training import train

BODY = "ramp-pointmass"
pytestmark = [
    pytest.mark.scale,
    pytest.mark.usefixtures("clean"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore:os.fork:RuntimeWarning"),  # as in scaling/cluster.py
    # It will change what it does about accelerators, of which we ask for none.
    pytest.mark.filterwarnings("ignore:.*accelerator.*:FutureWarning"),
]
EPOCHS = 3
quietly: Callable[..., Path] = functools.partial(
    train, BODY, preset="test", progress=False, collectors=2, epochs=EPOCHS
)


def agent_of(run: Path) -> dict[str, str]:
    """The checksum of every array of a finished run, its agent's among them."""
    path = run / "checkpoints" / f"{EPOCHS:06d}" / "state.safetensors"
    with safetensors.safe_open(path, framework="numpy") as file:
        return file.metadata()


@pytest.fixture
def clean() -> Iterator[None]:
    """Ray leaves its processes to the garbage collector, which then complains."""
    yield
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What two groups in this process come to."""
    return agent_of(quietly(run_dir=tmp_path_factory.mktemp("runs") / "here"))


@pytest.fixture
def at_begin(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, Callable], None]:
    """Has something done to a collector as soon as the n-th task of all has begun."""
    begin, count = on_cluster._Actor.begin, 0

    def set_up(task: int, then: Callable[[Any], None]) -> None:
        nonlocal count
        count = 0

        def begun(self: Any, method: str, *arguments: Any) -> None:
            nonlocal count
            begin(self, method, *arguments)
            count += 1
            if count == task:
                then(self)

        monkeypatch.setattr(on_cluster._Actor, "begin", begun)

    return set_up


def test_on_ray_a_run_is_what_it_is_here_though_a_collector_dies(
    expected: dict[str, str], tmp_path: Path, at_begin: Any
) -> None:
    import ray

    with scaling.on_ray(2) as crew:
        assert agent_of(quietly(run_dir=tmp_path / "straight", crew=crew)) == expected
        at_begin(6, lambda actor: ray.kill(actor._actor))
        assert agent_of(quietly(run_dir=tmp_path / "killed", crew=crew)) == expected
    assert not ray.is_initialized()


def test_a_node_may_be_lost_but_not_the_head(
    expected: dict[str, str], tmp_path: Path, at_begin: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    head = cluster.head_node
    assert head is not None
    try:
        lost, _ = (cluster.add_node(num_cpus=1) for _ in range(2))
        with scaling.on_ray(2, cluster.address) as crew:

            def lose(actor: Any) -> None:
                cluster.add_node(num_cpus=1)
                cluster.remove_node(lost, allow_graceful=False)

            at_begin(5, lose)
            assert agent_of(quietly(run_dir=tmp_path / "run", crew=crew)) == expected

            at_begin(4, lambda actor: head.kill_gcs_server())
            with pytest.raises(EverystateError, match="head of the Ray cluster"):
                # Its collectors work on without a head: the run must outlast a look at it.
                quietly(run_dir=tmp_path / "headless", crew=crew, epochs=1000)
    finally:
        cluster.shutdown()


def test_a_killed_driver_goes_on(expected: dict[str, str], tmp_path: Path) -> None:
    run = tmp_path / "run"
    words = ["train", BODY, "--preset", "test", "--collectors", "2", "--epochs", str(EPOCHS)]
    command = [sys.executable, "-m", "everystate", *words, "--quiet", "--run-dir", str(run)]
    process = subprocess.Popen(command, start_new_session=True)
    while not (run / "checkpoints" / "000001").exists():
        assert process.poll() is None
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    subprocess.run(command, check=True)
    assert agent_of(run) == expected


def test_who_differs_or_is_not_there_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        pytest.raises(EverystateError, match=r"no Ray cluster answers at 127\.0\.0\.1:9"),
        scaling.on_ray(2, "127.0.0.1:9"),
    ):
        pass
    here = on_cluster.versions() | {"jax": "0.0.1"}
    monkeypatch.setattr(on_cluster, "versions", lambda: here)
    with (
        scaling.on_ray(2) as crew,
        pytest.raises(EverystateError, match=r"other versions, .*jax \S+ there and 0.0.1 here"),
    ):
        quietly(run_dir=tmp_path / "run", crew=crew)
