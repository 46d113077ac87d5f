"""The folder of a run: whose it is, who writes to it, and what is refused before it is there."""

import json
import re
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from everystate import envs
from everystate.agent import BodyInfo
from everystate.errors import EverystateError
from everystate.presets import preset
from everystate.training import loop, train
from everystate.training.rundir import open_run
from test_training import BODY, contents, idle, quietly


def test_a_foreign_folder_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(EverystateError, match="is no run"):
        quietly(run_dir=tmp_path)
    with pytest.raises(EverystateError, match="is a file"):
        quietly(run_dir=tmp_path / "thesis.tex")
    assert contents(tmp_path) == {"thesis.tex": b"mine"}


def test_a_run_of_another_config_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "compiled", lambda config: idle())
    run = quietly(run_dir=tmp_path / "run", epochs=1)
    before = contents(run)
    with pytest.raises(
        EverystateError, match=r"learning_rate \S+ there and 0.01 here; width 16 there and 8 here"
    ):
        quietly(run_dir=run, epochs=2, learning_rate=0.01, width=8)
    assert contents(run) == before


def test_a_run_has_one_writer(tmp_path: Path) -> None:
    run = tmp_path / "run", preset("test"), BodyInfo(("x", "y"), 2)
    with (
        open_run(*run),
        pytest.raises(EverystateError, match="in use by another"),
        open_run(*run),
    ):
        pass
    with open_run(*run):
        pass


def test_a_body_that_an_update_changed_ends_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "compiled", lambda config: idle())
    run = quietly(run_dir=tmp_path / "run", epochs=1)
    known = json.loads((run / "config.json").read_text())["body"]
    assert known == {
        "model_hash": envs.make(BODY, 1, 0).model_hash,
        "versions": {"mujoco": version("mujoco")},
    }
    quietly(run_dir=run, epochs=1)
    text = (run / "config.json").read_text()
    (run / "config.json").write_text(text.replace(known["model_hash"], "0" * 64))
    before = contents(run)
    with pytest.raises(EverystateError, match=f"learned on another {BODY} than there is now"):
        quietly(run_dir=run, epochs=1)
    assert contents(run) == before


def test_a_run_of_an_older_format_is_refused(tmp_path: Path) -> None:
    run = tmp_path, preset("test"), BodyInfo(("x", "y"), 2)
    with open_run(*run):
        pass
    told = json.loads((tmp_path / "config.json").read_text())
    del told["body"]
    (tmp_path / "config.json").write_text(json.dumps(told | {"format": 7}))
    with pytest.raises(EverystateError, match="has format 7 and this"), open_run(*run):
        pass


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"config_or_body": "ramp-pointmas"}, "did you mean 'ramp-pointmass'"),
        ({"preset": "tset"}, "did you mean 'test'"),
        ({"batchsize": 3}, "did you mean 'batch_size'"),
        ({"num_bodies": 0}, "num_bodies = 0 is out of range"),
    ],
)
def test_wrong_arguments_write_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: dict[str, Any], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    asked: dict[str, Any] = {"config_or_body": BODY, "preset": "test", **arguments}
    with pytest.raises(EverystateError, match=re.escape(message)):
        train(**asked)
    assert not list(tmp_path.iterdir())
