"""Sweeps: what a file asks for, how what is there goes on, and what it comes to."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from everystate import scaling
from everystate.cli import main
from everystate.errors import EverystateError
from everystate.scaling import cluster, tuning
from everystate.scaling import trial as trials
from everystate.scaling.plan import Evaluation, Trial, read

ROOT = Path(__file__).parents[1]
SMALL = """
bodies = ["ramp-pointmass"]
preset = "test"
seeds = 2
[options]
epochs = 2
evaluation_period = 1
[evaluation]
plan = false
episodes = 10
"""
SETTINGS = "[settings.as-it-is]\n[settings.no-curriculum]\np_curric = 0.0\n"
SEARCH = """
bodies = ["ramp-pointmass"]
preset = "test"
[evaluation]
plan = false
episodes = 10
[search]
trials = 3
metric = "suites/rest/policy/success/max/all/0.5/hit"
[search.space]
learning_rate = {low = 1e-4, high = 1e-2, log = true}
N = {low = 1, high = 4}
hindsight = {choices = [true, false]}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "sweep.toml"
    path.write_text(text)
    return path


def evaluated(seed: int, success: float) -> dict[str, Any]:
    one = {"0.5": {"hit": 1.0, "end": success}}
    policy = {
        "score": {"floor": success, "all": success},
        "success": {"max": {"floor": one, "all": one}},
        "falls_per_1000_steps": {"all": 2.0},
    }
    return {
        "body": "ramp-pointmass",
        "config": {"seed": seed},
        "score": success,
        "suites": {"rest": {"tasks": 10, "policy": policy, "planning": None}},
    }


def keep(trial: Trial, out: Path, result: Mapping[str, Any]) -> None:
    """What a finished run leaves."""
    folder = out / trial.name
    folder.mkdir(parents=True, exist_ok=True)
    config = {"config": json.loads(json.dumps(trials.config_to_json(trial.config)))}
    (folder / "config.json").write_text(json.dumps(config))
    line = {"epoch": 1, "steps": 10, "episode/reached": 0.5, "eval/rest/score/all": 0.5}
    (folder / "metrics.jsonl").write_text(json.dumps(line) + "\n")
    (folder / "evaluation.json").write_text(json.dumps(result))


def test_runs_are_seed_by_seed_with_their_own_options(tmp_path: Path) -> None:
    found = read(write(tmp_path, SMALL + SETTINGS)).trials()
    assert [one.name for one in found] == [
        f"{name}/seed{seed}" for seed in (0, 1) for name in ("as-it-is", "no-curriculum")
    ]
    assert [(one.config.seed, one.config.p_curric) for one in found[1:3]] == [(0, 0.0), (1, 0.2)]
    assert {(one.config.epochs, one.config.evaluation_period) for one in found} == {(2, 1)}
    assert found[0].evaluation == Evaluation(plan=False, episodes=10)


def test_several_bodies_have_their_names_in_front(tmp_path: Path) -> None:
    text = SMALL.replace('["ramp-pointmass"]', '["ramp-pointmass", "cartpole"]')
    found = read(write(tmp_path, text)).trials()
    assert [(one.name, one.config.body) for one in found[:2]] == [
        ("ramp-pointmass-all/seed0", "ramp-pointmass"),
        ("cartpole-all/seed0", "cartpole"),
    ]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("seeds = 2", "seed = 2", "unknown seed: did you mean 'seeds'"),
        ("seeds = 2", "seeds = 0", "seeds = 0: give how many"),
        ("seeds = 2", "seeds = [1, 1]", "give how many, or a list"),
        ("seeds = 2", "seeds = [-1]", "seed = -1 is out of range"),
        ('["ramp-pointmass"]', '"ramp-pointmass"', "bodies: list one or more"),
        ("epochs = 2", "epoch = 2", "unknown field 'epoch': did you mean 'epochs'"),
        ("plan = false", "planning = false", "unknown evaluation.planning: did you mean 'plan'"),
        ("p_curric = 0.0", "p_curric = 2.0", "p_curric = 2.0 is out of range"),
        ("settings.as-it-is", 'settings."../x"', "choose a name that a folder can have"),
        ("bodies", "bodies =", "cannot be read as a sweep"),
        ('"test"', '"tset"', "did you mean 'test'"),
    ],
)
def test_what_is_wrong_in_a_file_is_told(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = (SMALL + SETTINGS).replace(old, new)
    assert text != SMALL + SETTINGS
    with pytest.raises(EverystateError, match=said.replace("(", r"\(")):
        read(write(tmp_path, text))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("trials = 3", "trials = 0", "search.trials = 0"),
        ("low = 1e-4", "low = 1", "give low and high"),
        ("N = {low = 1", "N = {low = 0", "N = 0 is out of range"),
        ("choices = [true, false]", "choice = [true]", "give low and high"),
        ("high = 1e-2", "high = 7.0", "learning_rate = 7.0 is out of range"),
        ('preset = "test"', "seeds = 2", "takes one body, one seed and no settings"),
    ],
)
def test_what_is_wrong_in_a_search_is_told(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(EverystateError, match=said):
        read(write(tmp_path, SEARCH.replace(old, new)))


def test_every_run_of_the_committed_sweeps_can_be_made() -> None:
    for path in (ROOT / "experiments").glob("*.toml"):
        assert len(read(path).trials()) >= 12


def test_a_run_is_trained_measured_and_then_left_alone(tmp_path: Path) -> None:
    trial = read(write(tmp_path, SMALL)).trials()[0]
    epochs: list[float] = []
    trials.run(trial, tmp_path, lambda metrics: epochs.append(metrics["epoch"]))
    kept = tmp_path / trial.name / "evaluation.json"
    assert epochs == [1, 2]
    assert json.loads(kept.read_text())["suites"]["rest"]["tasks"] == 10
    before = kept.stat().st_mtime_ns
    trials.run(trial, tmp_path)
    assert kept.stat().st_mtime_ns == before


def test_runs_keep_to_cores_of_their_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(trials.tempfile, "gettempdir", lambda: str(tmp_path))
    pinned: list[set[int]] = []
    monkeypatch.setattr(trials.os, "sched_getaffinity", lambda _: {0, 1})
    monkeypatch.setattr(trials.os, "sched_setaffinity", lambda _, cores: pinned.append(set(cores)))
    with trials.one_core(), trials.one_core(), trials.one_core():
        assert pinned == [{0}, {1}]
    with trials.one_core():
        assert pinned[-1] == {0}


def test_results_of_another_config_are_not_taken_for_these(tmp_path: Path) -> None:
    plan = read(write(tmp_path, SMALL + SETTINGS))
    keep(plan.trials()[0], tmp_path, evaluated(0, 0.5))
    changed = read(write(tmp_path, (SMALL + SETTINGS).replace("epochs = 2", "epochs = 4")))
    with pytest.raises(EverystateError, match="epochs 2 there, 4 here"):
        trials.require_same(changed.trials()[0], tmp_path)
    trials.require_same(plan.trials()[0], tmp_path)


def test_settings_are_told_over_their_seeds(tmp_path: Path) -> None:
    plan = read(write(tmp_path, SMALL + SETTINGS))
    for trial, success in zip(plan.trials(), (0.2, 0.6, 0.4, 1.0), strict=True):
        keep(trial, tmp_path, evaluated(trial.config.seed, success))
    lines = scaling.write(plan, tmp_path).splitlines()
    assert lines[0].startswith("| setting | seeds | floor | rest | falls per 1,000 steps |")
    assert lines[2].startswith("| as-it-is | 2 | 30 | 30 [20, 40] | 2.0 |")
    assert lines[3].startswith("| no-curriculum | 2 | 80 | 80 [60, 100] |")
    assert json.loads((tmp_path / "summary.json").read_text())["as-it-is"]["seeds"] == [0, 1]
    assert (tmp_path / "success.png").exists()


def test_a_search_goes_on_with_what_it_found(tmp_path: Path) -> None:
    plan = read(write(tmp_path, SEARCH))
    assert plan.search is not None
    for rate, done in ((1e-3, True), (2e-3, True), (3e-3, False)):
        values = {"learning_rate": rate, "N": 2, "hindsight": True}
        trial = plan.found(values)
        assert trial.config.learning_rate == rate
        if done:
            keep(trial, tmp_path, evaluated(0, rate))
        (tmp_path / trial.name).mkdir(exist_ok=True)
        (tmp_path / trial.name / "values.json").write_text(json.dumps(values))
    begun, scored = tuning.points(plan, plan.search, tmp_path)
    assert [values["learning_rate"] for values in begun] == [3e-3]
    assert {score for _, score in scored} == {1.0}
    assert scaling.write(plan, tmp_path).count("| trial-") == 2
    other = read(write(tmp_path, SEARCH.replace("N = {low", "j = {low")))
    assert other.search is not None
    with pytest.raises(EverystateError, match="another search"):
        tuning.points(other, other.search, tmp_path)


def test_that_ray_is_not_installed_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cluster, "find_spec", lambda name: None)
    path, out = write(tmp_path, SMALL), tmp_path / "out"
    assert main(["sweep", str(path), "--out", str(out)]) == 2
    assert "pip install 'ray[tune]' optuna" in capsys.readouterr().err
    assert not out.exists()


def test_skills_without_planning_have_their_column(tmp_path: Path) -> None:
    plan = read(write(tmp_path, SMALL))
    for trial in plan.trials():
        skills = {"skills": {"policy": {"climb": 0.4, "cross": 0.8}, "planning": None}}
        keep(trial, tmp_path, evaluated(trial.config.seed, 0.5) | skills)
    lines = scaling.write(plan, tmp_path).splitlines()
    assert "| skills, mean |" in lines[0]
    assert "| 60 |" in lines[2]
