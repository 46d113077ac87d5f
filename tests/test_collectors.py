"""Collectors: groups of bodies, wherever they are, whose deaths change nothing.

Here they are in this process and only seem to die; test_collectors_on_ray.py has those that do.
"""

import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from everystate import cli
from everystate.agent import Agent, BodyInfo
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.learning.models import Space
from everystate.presets import preset
from everystate.scaling import cluster
from everystate.training import checkpoint, groups
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
    restored = checkpoint.restore(tmp_path, TWO, Space(2, 2))
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
        ("--collectors 2", "pip install ray"),
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
    script = (
        "import sys, everystate.cli, everystate.scaling, everystate.studies, everystate.training\n"
    )
    subprocess.run([sys.executable, "-c", script + "sys.exit('ray' in sys.modules)"], check=True)
