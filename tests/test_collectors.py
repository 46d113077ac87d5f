"""Collectors: groups of bodies, wherever they are, whose deaths change nothing.

Those marked `scale` start Ray; the others have collectors in this process that only seem to die.
"""

import functools
import gc
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import safetensors

from everystate import cli, scaling
from everystate.agent import Agent, BodyInfo
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.presets import preset
from everystate.scaling import cluster
from everystate.scaling import collectors as on_cluster
from everystate.training import checkpoint, groups, train
from everystate.training.bodies import make_bodies
from everystate.training.checkpoint import Snapshot, _to_arrays
from everystate.training.collection import collect, warm_up
from everystate.training.groups import Collector, Groups, InProcess, LostError, size_of
from everystate.training.learner import compiled

BODY = "ramp-pointmass"


class Mortal(Collector):
    """One that is lost when its crew says so: before or after it did its work."""

    def __init__(self, collector: Collector, dies: Callable[[], str | None]) -> None:
        self._collector, self._dies = collector, dies

    def begin(self, method: str, *arguments: Any) -> None:
        self._collector.begin(method, *arguments)

    def wait(self, seconds: float) -> bool:
        return self._collector.wait(seconds)

    def result(self) -> Any:
        how = self._dies()
        if how != "before":
            result = self._collector.result()
        if how:
            raise LostError(f"killed {how}")
        return result  # pyright: ignore[reportPossiblyUnboundVariable]


class Fragile(InProcess):
    """A crew in this process whose collectors die at some of their tasks, counted over all."""

    def __init__(self, config: Config, deaths: dict[int, str]) -> None:
        super().__init__(compiled(config), make_bodies(config, size_of(config)))
        self.deaths, self.tasks, self.hired = deaths, 0, 0

    def hire(self, config: Config, groups: Sequence[int]) -> list[Collector]:
        self.hired += len(groups)
        self._first = make_bodies(config, size_of(config))  # The old one is gone.
        return [Mortal(collector, self._next) for collector in super().hire(config, groups)]

    def _next(self) -> str | None:
        self.tasks += 1
        return self.deaths.get(self.tasks)


def played(config: Config, deaths: dict[int, str] | None = None, epochs: int = 2) -> Snapshot:
    """Where some epochs without learning lead."""
    crew = Fragile(config, deaths or {})
    env, divided = make_bodies(config, 1), Groups(config, crew, lambda: False)
    snapshot = warm_up(config, env, divided)
    assert snapshot is not None
    for epoch in range(epochs):
        done = collect(compiled(config), divided, snapshot)
        assert done is not None
        agent, collected = done
        agent = agent._replace(epoch=jnp.int32(epoch + 1))
        snapshot = snapshot._replace(
            agent=agent, env=collected.env, observations=collected.observations
        )
    assert crew.hired == groups.number_of(config) + len(deaths or {})
    return snapshot


def same(one: Snapshot, other: Snapshot) -> bool:
    first, second = _to_arrays(one), _to_arrays(other)
    return first.keys() == second.keys() and all(
        x.tobytes() == second[name].tobytes() for name, x in first.items()
    )


TWO = preset("test", collectors=2)


@pytest.fixture(scope="module")
def undisturbed() -> Snapshot:
    return played(TWO)


# --- In this process ---


def test_two_groups_are_reproducible(undisturbed: Snapshot) -> None:
    assert same(played(TWO), undisturbed)
    assert not same(played(preset("test", collectors=2, seed=1)), undisturbed)
    assert len(undisturbed.env) == 2
    first, second = np.split(undisturbed.observations, 2)
    assert not np.array_equal(first, second), "each group has random numbers of its own"


def test_one_group_is_the_run_without_collectors() -> None:
    assert same(played(preset("test", collectors=1)), played(preset("test")))


@pytest.mark.parametrize(
    "deaths",
    [{3: "before"}, {4: "after"}, {1: "after", 3: "before", 6: "after"}, {3: "after", 5: "after"}],
    ids=str,
)
def test_a_dead_collector_is_replaced_and_nothing_shows(
    undisturbed: Snapshot, deaths: dict[int, str]
) -> None:
    """Tasks 1 and 2 are the warm-up; one of a dead collector is done again at once."""
    assert same(played(TWO, deaths), undisturbed)


def test_a_group_that_is_lost_again_and_again_ends_the_run() -> None:
    with pytest.raises(EverystateError, match=r"collector 0 was lost 3 times .*killed before"):
        played(TWO, {3: "before", 5: "before", 6: "before"})


def test_bodies_that_cannot_be_put_back_start_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("everystate.envs.MujocoVectorEnv.exact_restore", False)
    snapshot = played(TWO, {3: "after"})
    assert np.isfinite(snapshot.observations).all()
    assert not same(snapshot, played(TWO))


def test_checkpoints_have_every_group(undisturbed: Snapshot, tmp_path: Path) -> None:
    agent = undisturbed.agent
    exported = Agent(agent.models, agent.scale, TWO, BodyInfo(("x", "y"), 2))
    checkpoint.save(tmp_path, undisturbed, exported, 1)
    restored = checkpoint.restore(tmp_path, TWO, 2, 2)
    assert restored is not None
    assert same(restored, undisturbed)


@pytest.mark.parametrize(("bodies", "wanted", "near"), [(10, 4, 5), (10, 11, 10), (50, 7, 5)])
def test_collectors_have_as_many_bodies_each(bodies: int, wanted: int, near: int) -> None:
    said = f"collectors = {wanted} does not divide num_bodies = {bodies}: choose {near}"
    with pytest.raises(EverystateError, match=said):
        preset("test", num_bodies=bodies, collectors=wanted)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--collectors 2", "pip install 'ray[tune]'"),
        ("--collectors 3", "does not divide num_bodies = 10"),
        ("--ray-address auto", "say --collectors N too"),
    ],
)
def test_mistakes_are_told_and_write_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
    options: str,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cluster, "find_spec", lambda name: None)
    assert cli.main(["train", BODY, "--preset", "test", *options.split()]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not list(tmp_path.iterdir())


def test_ray_is_not_imported_without_collectors() -> None:
    script = "import sys, everystate.cli, everystate.scaling, everystate.training\n"
    subprocess.run([sys.executable, "-c", script + "sys.exit('ray' in sys.modules)"], check=True)


# --- On Ray ---

pytest_ray = [
    pytest.mark.scale,
    pytest.mark.usefixtures("clean"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore:os.fork:RuntimeWarning"),  # as in `scaling.collectors`
    # It will change what it does about accelerators, of which we ask for none.
    pytest.mark.filterwarnings("ignore:.*accelerator.*:FutureWarning"),
]
EPOCHS = 3
quietly: Callable[..., Path] = functools.partial(
    train, BODY, preset="test", progress=False, collectors=2, epochs=EPOCHS
)


def on_ray(test: Callable) -> Callable:
    return functools.reduce(lambda test, mark: mark(test), pytest_ray, test)


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


@on_ray
def test_on_ray_a_run_is_what_it_is_here_though_a_collector_dies(
    expected: dict[str, str], tmp_path: Path, at_begin: Any
) -> None:
    import ray

    with scaling.on_ray(2) as crew:
        assert agent_of(quietly(run_dir=tmp_path / "straight", crew=crew)) == expected
        at_begin(6, lambda actor: ray.kill(actor._actor))
        assert agent_of(quietly(run_dir=tmp_path / "killed", crew=crew)) == expected
    assert not ray.is_initialized()


@on_ray
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
                quietly(run_dir=tmp_path / "headless", crew=crew)
    finally:
        cluster.shutdown()


@on_ray
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


@on_ray
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
