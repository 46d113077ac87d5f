"""The page for newcomers does what it says: its files and its code are run."""

import re
import sys
from pathlib import Path

import pytest

from everystate import cli, envs
from everystate.presets import preset
from everystate.training.rundir import default_run_dir

PAGE = (Path(__file__).parents[1] / "docs" / "your-own-body.md").read_text()
SHORT = ["--preset", "test", "--epochs", "1", "--num-updates", "5", "--width", "8", "--quiet"]


def block(language: str, number: int = 0) -> str:
    """A code block of the page."""
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)[number]


def test_from_a_file_to_an_agent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(block("xml"))
    run = Path("runs/arm.xml-quick-seed0")
    assert f"everystate evaluate {run}" in PAGE
    assert default_run_dir(preset("quick", "arm.xml"), "quick") == run
    assert cli.main(["bodies", "arm.xml"]) == 0
    assert cli.main(["train", "arm.xml", "--run-dir", str(run), *SHORT]) == 0
    exec(block("python"), {})
    assert cli.main(["evaluate", str(run), "--episodes", "3"]) == 0


def test_a_class_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(block("xml"))
    Path("my_bodies.py").write_text(block("python", 1))
    monkeypatch.syspath_prepend(tmp_path)
    env = envs.make("my_bodies:Arm", 4, 0)
    del sys.modules["my_bodies"]
    assert env.scaling.spread[2] == 8.0
    assert env.control_step == pytest.approx(0.02)
    assert set(env.regions(env.reset(seed=0)[0])) == {"down"}


def test_every_body_named_on_the_page_exists() -> None:
    named = re.findall(r"everystate train (\w+:\S+)", PAGE)
    assert len(named) == 6
    for body in named:
        if not body.startswith("my_"):
            assert len(envs.make(body, 1, 0).state_names) > 2
