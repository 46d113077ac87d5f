"""Comparisons: the files they leave, how they go on, and what they refuse."""

import json
from pathlib import Path
from typing import Any

import pytest

from everystate import evaluation
from everystate.cli import main
from everystate.errors import EverystateError
from everystate.evaluation import perturbations
from everystate.peers import CONTESTANTS, Terms, compare, contestants
from everystate.peers.agents import PeerConfig, RandomActions
from everystate.peers.comparison import gather
from everystate.peers.tables import table
from everystate.presets import preset

TERMS = Terms("ramp-pointmass", minutes=1.0, preset="test", episodes=20, plan=False)


def results(folder: Path, seed: int, success: float, steps: list[int]) -> Path:
    """A run that looked at its success twice, 0.1 before the end and then `success`."""
    one = {eps: {"any": 1.0, "last": success} for eps in ("0.5", "1")}
    evaluated = {
        "body": "ramp-pointmass",
        "config": {"seed": seed},
        "success": {"floor": one, "all": one},
        "success_plan": {"floor": one, "all": one} if folder.parent.name == "ours" else None,
        "position_only": {"all": one},
        "skills": {"climb": success},
        "falls_per_1000_steps": 2.0,
        "coverage": {"cells": 0.5},
        "steps": steps[-1],
    }
    lines = [
        {"epoch": i + 1, "steps": n, "eval/success@0.5/all": s}
        for i, (n, s) in enumerate(zip(steps, (success - 0.1, success), strict=True))
    ]
    folder.mkdir(parents=True)
    (folder / "evaluation.json").write_text(json.dumps(evaluated))
    (folder / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return folder


@pytest.fixture
def gathered(tmp_path: Path) -> dict[str, Any]:
    """Two seeds of ours, one of another that took fewer steps."""
    ours = [results(tmp_path / f"ours/seed{i}", i, 0.9 + 0.1 * i, [100, 200]) for i in (0, 1)]
    other = [results(tmp_path / "sac-her/seed0", 0, 0.5, [50, 150])]
    return gather(TERMS._asdict(), {"ours": ours, "sac-her": other})


def test_equal_steps_are_those_of_the_slowest(gathered: dict[str, Any]) -> None:
    assert gathered["equal_steps"] == 150
    at = {
        name: agent["at_equal_steps"]["all"]["values"] for name, agent in gathered["agents"].items()
    }
    assert at["sac-her"] == [0.5]
    assert at["ours"] == pytest.approx([0.8, 0.9])  # the look before, after 100 steps


def test_the_table_has_a_row_for_planning(gathered: dict[str, Any]) -> None:
    lines = table(gathered).split("\n\n")[0].splitlines()
    rows = {cells[1].strip(): cells[2:-1] for line in lines if (cells := line.split("|"))}
    assert {len(line.split("|")) for line in lines} == {len(lines[0].split("|"))}
    assert list(rows)[2:] == ["ours", "sac-her", "ours, planning"]
    assert rows["ours"][0].strip() == "95"  # the median of 90 and 100
    assert rows["ours"][1].strip() == "95 [90, 100]"
    assert rows["sac-her"][5].strip() == "50"


def test_skills_have_a_table_of_their_own(gathered: dict[str, Any]) -> None:
    skills = table(gathered).split("\n\n")[1].splitlines()
    assert skills == [
        "| skills | climb |",
        "| --- | --- |",
        "| ours | 95 |",
        "| sac-her | 50 |",
    ]
    for agent in gathered["agents"].values():
        del agent["skills"]
    assert "skills" not in table(gathered)


def test_random_actions_are_compared_and_not_done_twice(tmp_path: Path) -> None:
    out = tmp_path / "out"
    found = compare(TERMS, ["random"], 1, out)
    assert found["agents"]["random"]["success"]["all"]["0.5"]["last"]["median"] < 0.5
    kept = out / "random/seed0/evaluation.json"
    assert json.loads(kept.read_text())["config"]["agent"] == "random"
    assert json.loads(kept.read_text())["calibration"]["mae"] is None
    written = kept.stat().st_mtime_ns
    compare(TERMS, ["random"], 1, out)
    assert kept.stat().st_mtime_ns == written
    with pytest.raises(EverystateError, match=r"minutes 1\.0 there, 2\.0 here"):
        compare(TERMS._replace(minutes=2.0), ["random"], 1, out)


def test_what_cannot_be_compared_is_told_before_any_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    for arguments, said in (
        ("ramp-pointmass --agents ours sac", "no agent 'sac' to compare"),
        ("ramp-pointmas --agents random", "did you mean 'ramp-pointmass'"),
        ("ramp-pointmass --agents", "no agents to compare"),
        ("ramp-pointmass --agents random --seeds 0", "choose from 1 to 100,000 seeds"),
        ("ramp-pointmass --agents random --minutes nan", "more than 0"),
        ("ramp-pointmass --agents random --episodes 201", "choose 1 to 200"),
        ("ramp-pointmass --agents random --preset quik", "did you mean 'quick'"),
    ):
        assert main(["compare", *arguments.split(), "--out", str(out)]) == 2
        assert said in capsys.readouterr().err
        assert not out.exists()
    (tmp_path / "mine").write_text("")
    assert main(["compare", "ramp-pointmass", "--agents", "random", "--out", str(tmp_path)]) == 2
    assert "is not empty and no comparison" in capsys.readouterr().err


def test_a_peer_that_is_not_installed_is_told_how_to_have_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(contestants, "find_spec", lambda name: None)
    with pytest.raises(EverystateError, match="pip install stable-baselines3 sb3-contrib"):
        compare(TERMS, ["sac-her"], 1, tmp_path / "out")


@pytest.mark.parametrize("name", [n for n, c in CONTESTANTS.items() if c.options])
def test_options_of_our_agents_are_options_of_train(name: str) -> None:
    words = CONTESTANTS[name].options or ()
    given = dict(zip(words[::2], words[1::2], strict=True))
    config = preset("quick", goals=given["--goals"], m=int(given["--m"]))
    assert config.m == int(given["--m"])


@pytest.mark.slow
def test_our_agent_is_stopped_when_its_time_is_over(tmp_path: Path) -> None:
    """A run that would take hours; what it learned until then is measured, and told over steps."""
    terms = TERMS._replace(minutes=1.0, options=("--epochs", "1000000"))
    found = compare(terms, ["ours"], 1, tmp_path / "out")
    ours = found["agents"]["ours"]
    assert ours["steps"]["median"] == found["equal_steps"] > 0
    assert ours["at_equal_steps"]["all"]["median"] >= 0
    assert (tmp_path / "out/comparison-minutes.png").exists()
    # Stopped between training and measuring: its time is over, so it is measured as it is.
    (tmp_path / "out/ours/seed0/evaluation.json").unlink()
    again = compare(terms, ["ours"], 1, tmp_path / "out")
    assert again["agents"]["ours"]["success"] == ours["success"]
    assert again["equal_steps"] == found["equal_steps"]


# --- Other worlds ---


def test_what_is_said_of_other_worlds() -> None:
    success = [0.9, *[0.5] * 23, 0.1, 0.2, 0.3]
    found = perturbations.summarised(success)
    assert found["nominal"] == 0.9
    assert found["worst"] == 0.1
    assert found["cvar10"] == pytest.approx(0.2)
    assert found["worlds"][0] == {"mass": 1.0, "force": 1.0, "action_noise": 0.0, "success": 0.9}
    assert len({tuple(world.items()) for world in perturbations.GRID}) == 27


def test_an_agent_is_measured_in_every_world() -> None:
    agent = RandomActions(PeerConfig("ramp-pointmass", (), 0, "random", {}))
    found = evaluation.evaluate(agent, plan=False, episodes=4, perturb=True)
    assert found["perturbed"]["policy"]["nominal"] == found["success"]["all"]["0.5"]["last"]
    assert found["perturbed"]["planning"] is None
    assert evaluation.evaluate(agent, plan=False, episodes=4)["perturbed"] is None
