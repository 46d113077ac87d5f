"""Sweeps: what a file asks for, how what is there goes on, and what it comes to."""

import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from everystate import studies
from everystate.agent import config_to_json
from everystate.cli import main
from everystate.errors import EverystateError
from everystate.scaling import cluster
from everystate.studies import Evaluation, Run, Study, Training, readings, runs
from everystate.studies.plan import read
from everystate.training.logging import read_metrics
from waiting import until

ROOT = Path(__file__).parents[1]
SMALL = """
body = "ramp-pointmass"
preset = "test"
seeds = 2
[options]
epochs = 2
evaluation_period = 1
[evaluation]
plan = false
episodes = 10
"""
CONDITIONS = "[conditions.as-it-is]\n[conditions.no-curriculum]\np_curric = 0.0\n"


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


def training(run: Run) -> Training:
    assert isinstance(run.task, Training)
    return run.task


def keep(run: Run, out: Path, result: Mapping[str, Any]) -> None:
    """What a finished run leaves."""
    folder = out / run.name
    folder.mkdir(parents=True, exist_ok=True)
    config = {"config": json.loads(json.dumps(config_to_json(training(run).config)))}
    (folder / "config.json").write_text(json.dumps(config))
    line = {"epoch": 1, "steps": 10, "episode/reached": 0.5, "eval/rest/score/all": 0.5}
    (folder / "metrics.jsonl").write_text(json.dumps(line) + "\n")
    (folder / "evaluation.json").write_text(json.dumps(result))


def test_runs_are_seed_by_seed_with_their_own_options(tmp_path: Path) -> None:
    found = read(write(tmp_path, SMALL + CONDITIONS)).runs()
    assert [one.name for one in found] == [
        f"{name}/seed{seed}" for seed in (0, 1) for name in ("as-it-is", "no-curriculum")
    ]
    configs = [training(one).config for one in found]
    assert [(config.seed, config.p_curric) for config in configs[1:3]] == [(0, 0.0), (1, 0.5)]
    assert {(config.epochs, config.evaluation_period) for config in configs} == {(2, 1)}
    assert training(found[0]).evaluation == Evaluation(plan=False, episodes=10)


def test_a_condition_may_have_a_body_a_preset_and_seeds_of_its_own(tmp_path: Path) -> None:
    text = (
        SMALL + '[conditions.a]\n[conditions.b]\nbody = "cartpole"\npreset = "quick"\nseeds = [3]\n'
    )
    found = read(write(tmp_path, text)).runs()
    assert [one.name for one in found] == ["a/seed0", "a/seed1", "b/seed3"]
    configs = [training(one).config for one in found]
    assert [config.body for config in configs] == ["ramp-pointmass"] * 2 + ["cartpole"]
    assert configs[2].num_bodies > configs[0].num_bodies
    assert configs[2].epochs == 2


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("seeds = 2", "seed = 2", "unknown seed: did you mean 'seeds'"),
        ("seeds = 2", "seeds = 0", "seeds = 0: give how many"),
        ("seeds = 2", "seeds = [1, 1]", "give how many, or a list"),
        ("seeds = 2", "seeds = [-1]", "seed = -1 is out of range"),
        ('"ramp-pointmass"', '["ramp-pointmass"]', "body: name one"),
        ("epochs = 2", "epoch = 2", "unknown field 'epoch': did you mean 'epochs'"),
        ("plan = false", "planning = false", "unknown evaluation.planning: did you mean 'plan'"),
        ("p_curric = 0.0", "p_curric = 2.0", "p_curric = 2.0 is out of range"),
        ("conditions.as-it-is", 'conditions."../x"', "choose a name that a folder can have"),
        ("body", "body =", "cannot be read as a study"),
        ('"test"', '"tset"', "did you mean 'test'"),
    ],
)
def test_what_is_wrong_in_a_file_is_told(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = (SMALL + CONDITIONS).replace(old, new)
    assert text != SMALL + CONDITIONS
    with pytest.raises(EverystateError, match=said.replace("(", r"\(")):
        read(write(tmp_path, text))


def test_every_run_of_the_committed_studies_can_be_made() -> None:
    files = sorted((ROOT / "experiments").glob("*.toml"))
    assert files
    for path in files:
        assert len(read(path).runs()) >= 2


def test_a_run_is_trained_measured_and_then_left_alone(tmp_path: Path) -> None:
    (run, _) = read(write(tmp_path, SMALL)).runs()
    typed = {"command": "everystate sweep x", "argv": ["everystate", "sweep", "x"]}
    run.task(tmp_path / run.name, typed)
    kept = tmp_path / run.name / "evaluation.json"
    found = json.loads(kept.read_text())
    assert found["suites"]["rest"]["tasks"] == 10
    assert found["command"] == "everystate sweep x"
    assert found["steps"] == read_metrics(kept.parent)[-1]["steps"]
    before = kept.stat().st_mtime_ns
    run.task(tmp_path / run.name, typed)
    assert kept.stat().st_mtime_ns == before


def test_results_of_another_config_are_not_taken_for_these(tmp_path: Path) -> None:
    study = read(write(tmp_path, SMALL + CONDITIONS))
    run = study.runs()[0]
    keep(run, tmp_path, evaluated(0, 0.5))
    changed = read(write(tmp_path, (SMALL + CONDITIONS).replace("epochs = 2", "epochs = 4")))
    with pytest.raises(EverystateError, match="epochs 2 there, 4 here"):
        studies.sweep(changed, tmp_path)
    config = training(run).config
    runs.require_same(config, tmp_path / run.name)
    runs.require_same(replace(config, interval=0), tmp_path / run.name)  # it has what was measured
    with pytest.raises(EverystateError, match="interval 1 there, 3 here"):
        runs.require_same(replace(config, interval=3), tmp_path / run.name)


def kept_study(folder: Path) -> Study:
    study = read(write(folder, SMALL + CONDITIONS))
    for run, success in zip(study.runs(), (0.2, 0.6, 0.4, 1.0), strict=True):
        keep(run, folder, evaluated(training(run).config.seed, success))
    return study


def test_conditions_are_told_over_their_seeds(tmp_path: Path) -> None:
    lines = studies.write(kept_study(tmp_path), tmp_path).splitlines()
    assert lines[0].startswith("| rest | seeds | floor | all | worst seed | end @1 |")
    assert lines[2].startswith("| as-it-is | 2 | 30 | 30 [20, 40] | 20 |")
    assert lines[3].startswith("| no-curriculum | 2 | 80 | 80 [60, 100] | 60 |")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["conditions"]["as-it-is"]["seeds"] == [0, 1]
    assert (tmp_path / "summary.png").exists()


def test_conditions_of_several_bodies_have_tables_of_their_own(tmp_path: Path) -> None:
    text = SMALL + '[conditions.a]\n[conditions.b]\nbody = "cartpole"\n[conditions.c]\n'
    study = read(write(tmp_path, text))
    for run in study.runs()[:2]:
        found = evaluated(0, 0.5) | {"body": training(run).config.body}
        keep(run, tmp_path, found)
    said = studies.write(study, tmp_path)
    assert said.count("| rest | seeds |") == 2
    assert said.index("ramp-pointmass:") < said.index("| a |") < said.index("cartpole:")
    assert "No run of c was finished" in said


READINGS = '[readings]\nnames = ["eval/rest/score/all"]\nepochs = [1, 2]\n'


def logged(folder: Path, values: list[float]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    lines = [{"epoch": i + 1, "eval/rest/score/all": x} for i, x in enumerate(values)]
    (folder / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))


def test_readings_are_told_seed_by_seed_and_how_far_they_fell(tmp_path: Path) -> None:
    study = kept_study(tmp_path)
    logged(tmp_path / "as-it-is/seed0", [0.5, 0.2, 0.4])
    logged(tmp_path / "as-it-is/seed1", [0.4, 0.9, 0.8])
    (tmp_path / "no-curriculum/seed0/metrics.jsonl").unlink()
    logged(tmp_path / "no-curriculum/seed0/run", [0.3])  # it is still at it
    (tmp_path / "no-curriculum/seed1/metrics.jsonl").unlink()
    wanted = read(write(tmp_path, SMALL + READINGS + CONDITIONS)).readings
    assert wanted is not None
    rows = readings.write(wanted, study.conditions, tmp_path).splitlines()
    assert rows[0].startswith(
        "| eval/rest/score/all | seeds | epoch 1 | median | worst | epoch 2 |"
    )
    cells = "0.50 0.40 | 0.45 | 0.40 | 0.20 0.90 | 0.55 | 0.20 | 0.30 0.10 | 0.20 | 0.30 |"
    assert rows[2] == f"| as-it-is | 2 | {cells}"
    cells = "0.30 – | 0.30 | 0.30 | – | – | – | 0.00 – | 0.00 | 0.00 |"
    assert rows[3] == f"| no-curriculum | 2 | {cells}"
    kept = json.loads((tmp_path / "readings.json").read_text())["readings"]
    assert kept["eval/rest/score/all"]["as-it-is"]["epochs"]["2"] == [0.2, 0.9]
    with pytest.raises(EverystateError, match="did you mean 'eval/rest/score/all'"):
        readings.write(wanted._replace(names=("eval/rest/score/al",)), study.conditions, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("names", "name", "unknown readings.name: did you mean 'names'"),
        ('["eval/rest/score/all"]', "[]", "readings.names: list some"),
        ("[1, 2]", '["1"]', "list numbers"),
        ("[1, 2]", "[3]", "readings after epoch 3 of 2"),
        ("evaluation_period = 1", "evaluation_period = 2", "there are some every 2 epochs"),
        ("evaluation_period = 1", "evaluation_period = 0", "another evaluation_period"),
    ],
)
def test_readings_that_there_will_not_be_are_told(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    with pytest.raises(EverystateError, match=said):
        read(write(tmp_path, (SMALL + READINGS + CONDITIONS).replace(old, new)))


def test_that_ray_is_not_installed_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cluster, "find_spec", lambda name: None)
    path, out = write(tmp_path, SMALL), tmp_path / "out"
    assert main(["sweep", str(path), "--out", str(out), "--ray-address", "auto"]) == 2
    assert "pip install ray" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.slow
def test_a_killed_sweep_goes_on_to_the_same_results(tmp_path: Path) -> None:
    path = write(
        tmp_path, SMALL.replace("seeds = 2", "seeds = 1").replace("epochs = 2", "epochs = 12")
    )
    killed, whole = tmp_path / "killed", tmp_path / "whole"

    def sweep(out: Path) -> subprocess.Popen[bytes]:
        words = ["sweep", str(path), "--out", str(out), "--workers", "1"]
        return subprocess.Popen([sys.executable, "-m", "everystate", *words])

    first = sweep(killed)
    until(lambda: any((killed / "all/seed0/run/checkpoints").glob("[0-9]*")), 300)
    first.kill()
    first.wait()
    assert not (killed / "all/seed0/evaluation.json").exists()
    for out in (killed, whole):
        assert sweep(out).wait(600) == 0
    ends = [json.loads((out / "all/seed0/evaluation.json").read_text()) for out in (killed, whole)]
    for name in ("suites", "config", "steps", "coverage"):
        assert ends[0][name] == ends[1][name]
