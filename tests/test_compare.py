"""Comparisons: the files they leave, how they go on, and what they refuse."""

import json
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from everystate import evaluation
from everystate.cli import main
from everystate.errors import EverystateError
from everystate.evaluation import DoNothing, RandomActions, perturbations, raw
from everystate.peers.agents import PeerConfig
from everystate.presets import preset
from everystate.studies import Run, Terms, agents, compare, comparison, rescore, table, timed
from everystate.studies.agents import AGENTS
from everystate.studies.comparison import write
from everystate.studies.summary import gather
from everystate.studies.timed import Timed
from everystate.training.logging import read_metrics
from waiting import until

TERMS = Terms("ramp-pointmass", minutes=1.0, preset="test", episodes=20, plan=False)
TYPED = {"command": "everystate compare", "argv": ["everystate", "compare"]}


def results(folder: Path, seed: int, success: float, steps: list[int]) -> Path:
    """A run that looked at its success twice, 0.1 before the end and then `success`."""
    one = {eps: {"hit": 1.0, "end": success} for eps in ("0.5", "1")}
    policy = {
        "score": {"floor": success, "all": success},
        "success": {"max": {"floor": one, "all": one}, "rms": {"floor": one, "all": one}},
        "position_only": {"all": one},
        "closest": {"all": {"nearest": 0.25}},
        "falls_per_1000_steps": {"all": 2.0},
    }
    planning = {"score": policy["score"]} if folder.parent.name == "ours" else None
    evaluated = {
        "body": "ramp-pointmass",
        "config": {"seed": seed},
        "suites": {"rest": {"policy": policy, "planning": planning}},
        "skills": {"policy": {"climb": success}, "planning": None, "starts": 100},
        "coverage": {"cells": 0.5},
        "steps": steps[-1],
    }
    lines = [
        {"epoch": i + 1, "steps": n, "eval/rest/score/all": s}
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
    conditions = gather({"ours": ours, "sac-her": other}, equal_steps=150)
    return {**TERMS._asdict(), "equal_steps": 150, "conditions": conditions}


def test_scores_are_told_after_equal_steps(gathered: dict[str, Any]) -> None:
    at = {
        name: agent["at_equal_steps"]["rest/all"]["values"]
        for name, agent in gathered["conditions"].items()
    }
    assert at["sac-her"] == [0.5]
    assert at["ours"] == pytest.approx([0.8, 0.9])  # the look before, after 100 steps


def test_the_table_has_a_row_for_planning(gathered: dict[str, Any]) -> None:
    lines = table(gathered).split("\n\n")[0].splitlines()
    assert lines[0].startswith("| rest | seeds | floor | all |")
    rows = {cells[1].strip(): cells[2:-1] for line in lines if (cells := line.split("|"))}
    assert {len(line.split("|")) for line in lines} == {len(lines[0].split("|"))}
    assert list(rows)[2:] == ["ours", "sac-her", "ours, planning"]
    assert [cell.strip() for cell in rows["ours"][:4]] == ["2", "95", "95 [90, 100]", "90"]
    assert [cell.strip() for cell in rows["sac-her"][:2]] == ["1", "50"]
    assert [cell.strip() for cell in rows["sac-her"][-2:]] == ["0.25", "50"]
    assert {cell.strip() for cell in rows["ours, planning"][4:]} == {"—"}


def test_skills_have_a_table_of_their_own(gathered: dict[str, Any]) -> None:
    skills = [part.splitlines() for part in table(gathered).split("\n\n")]
    assert skills[1] == [
        "| skills | climb |",
        "| --- | --- |",
        "| ours | 95 |",
        "| sac-her | 50 |",
        "| ours, planning | — |",
    ]
    for agent in gathered["conditions"].values():
        del agent["skills"]
    assert "| skills |" not in table(gathered)


def test_no_row_is_left_out(gathered: dict[str, Any]) -> None:
    del gathered["conditions"]["sac-her"]["skills"]
    found = {"conditions": gather({"tqc-her": []})}
    gathered["conditions"] |= found["conditions"]
    text = table(gathered)
    assert text.count("| tqc-her | 0 | — | — |") == 1
    assert "| tqc-her | — | — | — |" in text  # of the runs
    assert "No run of tqc-her was finished." in text
    assert "| sac-her | — |" in text
    assert "| tqc-her | — |" in text
    assert "No run of tqc-her" in table(found)


def test_random_and_nothing_are_compared_and_not_done_twice(tmp_path: Path) -> None:
    out = tmp_path / "out"
    found = compare(TERMS, ["random"], 1, out)
    assert list(found["conditions"]) == ["nothing", "random"]
    policies = {name: a["suites"]["rest"]["policy"] for name, a in found["conditions"].items()}
    assert policies["random"]["score"]["all"]["median"] < 0.5
    falls = {tuple(p["falls_per_1000_steps"]["all"]["values"]) for p in policies.values()}
    assert len(falls) == 2
    skills = [set(agent["skills"]["policy"]) for agent in found["conditions"].values()]
    assert skills[0] == skills[1]
    kept = out / "random/seed0/evaluation.json"
    assert json.loads(kept.read_text())["config"]["agent"] == "random"
    rest = raw.check(kept)["suites"]["rest"]["policy"]
    assert rest["calibration"]["mae"] is None
    written = kept.stat().st_mtime_ns
    compare(TERMS, ["random"], 1, out)
    assert kept.stat().st_mtime_ns == written
    with pytest.raises(EverystateError, match=r"minutes 1\.0 there, 2\.0 here"):
        compare(TERMS._replace(minutes=2.0), ["random"], 1, out)
    block = json.loads((out / "blocks/seed0.json").read_text())
    cores = [
        json.loads((out / f"{n}/seed0/evaluation.json").read_text())["cores"]
        for n in found["conditions"]
    ]
    assert cores[0] == cores[1]
    assert len(cores[0]) == 1
    rescore("ramp-pointmass", out)
    again = json.loads((kept.parent / "rescored.json").read_text())
    assert again["suites"] == json.loads(kept.read_text())["suites"]
    assert kept.stat().st_mtime_ns == written
    elsewhere = block | {"machine": {"cpu": "another"}}
    (out / "blocks/seed0.json").write_text(json.dumps(elsewhere))
    compare(TERMS, ["random"], 1, out)  # it has nothing left to do there
    kept.unlink()
    with pytest.raises(EverystateError, match="seed 0 was begun on another machine"):
        compare(TERMS, ["random"], 1, out)


def test_a_block_is_a_seed_and_what_failed_does_not_stop_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[list[str]] = []

    def run_all(blocks: list[list[Run]], *_: Any, **__: Any) -> list[str]:
        made.extend([run.name for run in block] for block in blocks)
        return ["random/seed1: error: it fell over"]

    monkeypatch.setattr(comparison.pool, "run_all", run_all)
    with pytest.raises(EverystateError, match=r"1 runs failed.*random/seed1"):
        compare(TERMS, ["ours"], 2, tmp_path / "out")
    assert made == [[f"{n}/seed{seed}" for n in ("ours", "nothing", "random")] for seed in (0, 1)]
    for seed in (0, 1):
        machine = json.loads((tmp_path / f"out/blocks/seed{seed}.json").read_text())["machine"]
        assert machine["cores"] == os.cpu_count()


def test_doing_nothing_and_random_actions() -> None:
    states = np.zeros((3, 3), np.float32)
    config = PeerConfig("ramp-pointmass", (), 0, "random", {})
    assert not DoNothing(config).act(states, states).any()
    first, second = (RandomActions(config, n).act(states, states, seed=5) for n in (0, 1))
    assert first.shape == (3, 2)
    assert (first != second).any()  # every seed has actions of its own
    np.testing.assert_array_equal(RandomActions(config).act(states, states, seed=5), first)


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
        ("ramp-pointmass --rescore", "holds no comparison"),
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
    monkeypatch.setattr(agents, "find_spec", lambda name: None)
    with pytest.raises(EverystateError, match="pip install stable-baselines3 sb3-contrib"):
        compare(TERMS, ["sac-her"], 1, tmp_path / "out")


@pytest.mark.parametrize("name", [n for n, c in AGENTS.items() if c.options])
def test_options_of_our_agents_are_options_of_train(name: str) -> None:
    given = AGENTS[name].options or {}
    assert preset("quick", **given).m == given["m"]


@pytest.mark.slow
def test_our_agent_is_stopped_when_its_time_is_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it learned until then is measured, and told over steps.

    Its time is over when it has looked at its success, not by the clock.
    """
    terms = TERMS._replace(minutes=0.001)
    folder = tmp_path / "out"
    run, one = folder / "ours/seed0/run", folder / "ours/seed0"
    given = preset(terms.preset, terms.body, epochs=1_000_000, evaluation_period=10)
    monkeypatch.setattr(timed, "preset", lambda *_, **__: given)

    def looks() -> list[dict[str, Any]]:
        return [line for line in read_metrics(run) if "eval/rest/score/all" in line]

    class WhenItHasLooked(threading.Timer):
        def __init__(self, seconds: float, ring: Callable[[], None]) -> None:
            super().__init__(0, lambda: (until(lambda: bool(looks()), seconds=900), ring()))

    monkeypatch.setattr(timed, "Timer", WhenItHasLooked)
    Timed("ours", 0, terms)(one, TYPED)
    (folder / "terms.json").write_text(json.dumps(terms._asdict()))
    found = write(folder, ["ours"])
    ours = found["conditions"]["ours"]
    assert ours["steps"]["median"] == found["equal_steps"] == read_metrics(run)[-1]["steps"] > 0
    assert ours["at_equal_steps"]["rest/all"]["median"] == looks()[-1]["eval/rest/score/all"]
    assert (folder / "comparison-minutes.png").exists()

    # Stopped between training and measuring: its time is over, so it is measured as it is.
    (one / "evaluation.json").unlink()
    monkeypatch.setattr(timed.training, "train", None)
    Timed("ours", 0, terms)(one, TYPED)
    again = write(folder, ["ours"])
    assert again["conditions"]["ours"]["suites"] == ours["suites"]
    assert again["equal_steps"] == found["equal_steps"]


def test_an_interrupt_that_is_not_the_clock_s_is_one() -> None:
    with timed.interrupted_after(0.05):
        time.sleep(10)
    with pytest.raises(KeyboardInterrupt), timed.interrupted_after(60.0):
        raise KeyboardInterrupt


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
    assert found["perturbed"]["policy"]["nominal"] == found["score"]
    assert found["perturbed"]["planning"] is None
    assert evaluation.evaluate(agent, plan=False, episodes=4)["perturbed"] is None
