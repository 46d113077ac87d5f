"""Trackers are told of every epoch, once, under its number; and only imported if asked for."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import everystate
from everystate import cli, training
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.training import loop
from everystate.training.logging import read_metrics
from test_training import idle, quietly


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What a tracker is told, in order; it stands where trackio would."""
    found: list[Any] = []

    def init(**options: Any) -> SimpleNamespace:
        found.append(options)
        return SimpleNamespace(
            log=lambda metrics, step: found.append((step, metrics)),
            finish=lambda: found.append("finished"),
        )

    monkeypatch.setitem(sys.modules, "trackio", SimpleNamespace(init=init))  # pyright: ignore
    return found


def test_every_epoch_is_told_once(
    told: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "compiled", lambda config: idle())
    with everystate.Tracker("trackio", name="mine") as tracker:
        run = quietly(run_dir=tmp_path / "run", epochs=2, on_epoch=tracker)
    first, second = read_metrics(run)
    options = {"project": "everystate", "name": "mine"}
    assert told == [options, (1, first), (2, second), "finished"]


def test_a_tracker_ends_with_a_run_that_fails(told: list[Any]) -> None:
    with pytest.raises(EverystateError), everystate.Tracker("trackio", project="ramp"):
        quietly(num_bodies=0)
    assert told == [{"project": "ramp"}, "finished"]


def test_a_tracker_that_is_not_installed_is_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "wandb", None)  # pyright: ignore
    assert cli.main(["train", "cartpole", "--track", "wandb"]) == 2
    assert "cannot track with wandb" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_command_line_names_the_run_and_tells_its_config(
    told: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def train(body: str, *, on_epoch: Any, **how: Any) -> Path:
        config = Config(body, **{n: x for n, x in how.items() if n in fields})
        on_epoch({"epoch": 3})
        told.append(config)
        return Path("run")

    fields = {field.name for field in dataclasses.fields(Config)}
    monkeypatch.setattr(training, "train", train)
    words = ["--preset", "test", "--seed", "2", "--track", "trackio"]
    assert cli.main(["train", "cartpole", *words]) == 0
    options, epoch, config, end = told
    assert (epoch, end) == ((3, {"epoch": 3}), "finished")
    assert options.pop("config") == dataclasses.asdict(config)
    assert options == {"project": "everystate", "name": "cartpole-test-seed2"}


@pytest.mark.track
@pytest.mark.parametrize(
    ("tool", "kept"),
    [
        ("wandb", "wandb/offline-run-*/*.wandb"),
        ("trackio", ".cache/huggingface/trackio/everystate.db"),
    ],
)
def test_a_real_tracker_keeps_the_metrics_on_this_machine(
    tool: str, kept: str, tmp_path: Path
) -> None:
    words = ["train", "ramp-pointmass", "--preset", "test", "--epochs", "1", "--track", tool]
    here = {"HOME": str(tmp_path), "WANDB_MODE": "offline", "WANDB_ERROR_REPORTING": "false"}
    command = [sys.executable, "-m", "everystate", *words]
    subprocess.run(command, cwd=tmp_path, env=os.environ | here, check=True)
    (found,) = tmp_path.glob(kept)
    assert b"time/updates_per_s" in found.read_bytes()
