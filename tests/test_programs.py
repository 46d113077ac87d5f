"""Programs that were traced by one process serve the next, and only where they are the same."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from everystate.hyperparameters import FlowFamily
from everystate.presets import preset
from everystate.training import programs

CONFIG = preset("test")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(programs, "programs_folder", lambda: tmp_path / "programs")
    return tmp_path / "programs"


def twice(folder: Path, *, config=CONFIG, size: int = 3, name: str = "double") -> list[int]:
    """How often a function is traced by a first and by a second process that keep it."""
    counts = []
    for _ in range(2):
        traced = []

        def double(x: jax.Array, traced: list = traced) -> jax.Array:
            traced.append(1)
            return 2 * x

        x = jnp.arange(float(size))
        np.testing.assert_array_equal(programs.kept(name, config, (), double, (x,))(x), 2 * x)
        counts.append(len(traced))
    return counts


def test_a_program_is_traced_once_for_all_processes(folder: Path) -> None:
    assert twice(folder) == [1, 0]
    assert twice(folder) == [0, 0]
    assert twice(folder, config=preset("test", seed=5)) == [0, 0], "a seed changes no program"


def test_what_a_program_depends_on_makes_another(folder: Path) -> None:
    assert twice(folder) == [1, 0]
    assert twice(folder, config=preset("test", N=5)) == [1, 0]
    assert twice(folder, size=4) == [1, 0]
    assert twice(folder, name="treble") == [1, 0]
    with jax.default_matmul_precision("float32"):
        assert twice(folder) == [1, 0]


def test_a_damaged_one_is_made_anew(folder: Path) -> None:
    twice(folder)
    (path,) = folder.iterdir()
    for damage in (b"", b"no program", path.read_bytes()[:50]):
        path.write_bytes(damage)
        with pytest.warns(UserWarning, match="is damaged"):
            assert twice(folder) == [1, 0]


def test_without_a_folder_to_write_to_it_works_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(programs, "programs_folder", lambda: Path("/proc/none"))
    with pytest.warns(UserWarning, match="cannot keep"):
        assert twice(Path()) == [1, 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flow", "programs"),
    [("pldu", ["act", "draw", "init", "observe", "update"]), ("coupling-spline", [])],
)
def test_a_run_is_the_same_by_traced_and_by_kept_programs(
    tmp_path: Path, flow: FlowFamily, programs: list[str]
) -> None:
    def metrics(name: str, **environment: str) -> list[str]:
        words = ["train", "ramp-pointmass", "--preset", "test", "--epochs", "2", "--flow", flow]
        run = tmp_path / name
        inherited = {k: x for k, x in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
        subprocess.run(
            [sys.executable, "-m", "everystate", *words, "--quiet", "--run-dir", str(run)],
            check=True,
            env=inherited | environment,
        )
        lines = (run / "metrics.jsonl").read_text().splitlines()
        return [line.partition(', "time/')[0] for line in lines]

    cache = str(tmp_path / "cache")
    first = metrics("traced", EVERYSTATE_CACHE=cache)
    paths = (tmp_path / "cache").glob("programs/*")
    assert sorted(path.name.partition("-")[0] for path in paths) == programs
    assert metrics("kept", EVERYSTATE_CACHE=cache) == first
