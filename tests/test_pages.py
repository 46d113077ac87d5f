"""README and pages of docs/ do what they say: every block of theirs is run, in reading order."""

import functools
import importlib
import inspect
import re
import runpy
import shlex
import sys
import urllib.request
from pathlib import Path
from typing import Any

import pytest

import everystate
from everystate import Agent, cli, presets
from everystate.evaluation import performances, suites
from everystate.training import train
from everystate.viewing.studio import Studio

ROOT = Path(__file__).parents[1]
# Fenced with its language and, for a file to be saved, its title; or commands, indented.
BLOCK = re.compile(r'^```(\w+)(?: title="(.+)")?\n((?:[^\n]*\n)*?)```$|((?:^    [^\n]*\n)+)', re.M)
# Commands that are not run here, and where else, or why not.
ELSEWHERE = {
    "make": "by .ci/run",
    "pip": "in test_wheel.py",
    ".": "the shell's",
}
SHORTER = {
    "render": ["--size", "160", "120"],
    "studio": ["--port", "0"],
    "compare": ["--agents", "random", "--seeds", "1"],
}


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """`quick` is an epoch of preset `test`; goals and starts are six; a studio is glanced at."""
    monkeypatch.chdir(tmp_path)
    load, perform = suites.load, performances.perform
    monkeypatch.setattr(suites, "load", lambda *a, **k: load(*a, **k).subset(6))
    monkeypatch.setattr(performances, "perform", lambda *a, **k: perform(*a, **k | {"starts": 6}))
    monkeypatch.setattr(presets, "_QUICK", presets._QUICK | presets.TINY | {"epochs": 1})

    def look(studio: Studio) -> None:
        with urllib.request.urlopen(studio.address) as answer:
            assert answer.status == 200

    monkeypatch.setattr(Studio, "wait", look)


def run(command: str, names: dict[str, str]) -> None:
    """One line of a shell: ours is run, with placeholders filled in; another's is accounted for."""
    words = shlex.split(command, comments=True)
    if not words:
        return
    program, arguments = Path(words[0]).name, [names.get(word, word) for word in words[1:]]
    if program == "python":
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", arguments)
            runpy.run_path(arguments[0])
        return
    if program != "everystate":
        assert words[0] in ELSEWHERE, f"who runs {command!r}?"
        if program == "make":
            assert arguments[0] in (ROOT / ".ci" / "run").read_text()
        return
    assert cli.main([*arguments, *SHORTER.get(arguments[0], [])]) == 0, command


def read(page: str, names: dict[str, str]) -> dict[str, Any]:
    """Runs the page; returns what its Python code left."""
    left: dict[str, Any] = {}
    for language, title, fenced, indented in BLOCK.findall((ROOT / page).read_text()):
        if title:
            Path(title).write_text(fenced)
        elif language == "python":
            exec(compile(fenced, page, "exec"), left)
        elif language != "text":
            assert not language, f"{page} has a block of {language} that nobody runs"
            for line in indented.splitlines():
                run(line, names)
    return left


def test_what_readme_says_stands_here_for_what_is_known_elsewhere_is_there() -> None:
    page = (ROOT / "README.md").read_text()
    table = re.search(r"\| there \| here \|\n(?:\|.*\n)+", page)
    assert table
    code = [part for row in table[0].splitlines()[2:] for part in re.findall("`(.+?)`", row)]
    found = [name for part in code for name in re.findall(r"(?<![\w.])(everystate\.[\w.]+)", part)]
    assert len(found) >= 8
    for name in found:
        functools.reduce(getattr, name.split(".")[1:], everystate)
    asked = [name for part in code for name in re.findall(r"(?<![\w.])agent\.(\w+)", part)]
    assert {"predict", "export", "units", "observation_space", "action_space"} <= set(asked)
    assert all(hasattr(Agent, name) for name in asked)
    known = {**inspect.signature(train).parameters, **presets.preset("test").__dict__}
    given = [
        name
        for part in code
        if part.startswith("everystate.train(")
        for name in re.findall(r"(\w+)=", part)
    ]
    assert {"on_epoch", "evaluation_period"} <= set(given) <= set(known)
    commands = [part.split()[1] for part in code if part.startswith("everystate ")]
    assert set(commands) == {"evaluate", "train"}


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_the_tutorial() -> None:
    left = read("docs/tutorial.md", {})
    assert left["observation"][1] > 0.95  # the cosine of the pole's angle
    assert Path("cartpole-balance.mp4").stat().st_size > 10_000
    assert Path("my-arm/agent.json").exists()


@pytest.mark.usefixtures("small")
def test_the_readme() -> None:
    left = read("README.md", {"RUN": "runs/ramp-pointmass-quick-seed1", "NAME": "climb"})
    assert left["actions"].shape == (100, 2)
    assert Path("ramp-pointmass-climb.mp4").exists()


@pytest.mark.usefixtures("small")
def test_the_page_on_agents_elsewhere(capsys: pytest.CaptureFixture) -> None:
    Path("examples").symlink_to(ROOT / "examples")
    left = read("docs/elsewhere.md", {})
    assert left["action"].shape == (1,)
    assert left["observation"].shape == left["info"]["goal"].shape == (2,)
    assert "angle from upright" in capsys.readouterr().out


@pytest.mark.usefixtures("small")
def test_the_page_on_parts_of_states() -> None:
    left = read("docs/goals.md", {})
    assert left["whole"][1] == pytest.approx(1, abs=1e-4)
    assert left["whole"][3:] == pytest.approx([0, 0], abs=1e-4)
    assert Path("cartpole-goal.mp4").exists()


@pytest.mark.peers
@pytest.mark.usefixtures("small")
def test_the_benchmark(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    sac = importlib.import_module("stable_baselines3").SAC
    learn = sac.learn
    monkeypatch.setattr(sac, "learn", lambda model, steps: learn(model, min(steps, 1_100)))
    read("docs/benchmark.md", {})
    assert "cartpole, suite motion, 6 tasks" in capsys.readouterr().out
