"""The command line: wires, one-line errors, and exit codes."""

import dataclasses
import json
import os
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from rich.table import Table

from everystate import cli, envs, evaluation, training, viewing
from everystate.cli import progress
from everystate.cli.options import Train
from everystate.cli.sections import FIRST, sections
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.evaluation import raw
from everystate.presets import preset

RESULT = {"suites": {"rest": {"policy": {"score": {"all": 1.0}}}}}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Any]]:
    """What the commands ask of the package; nothing is trained or measured."""
    asked: list[tuple[str, Any]] = []

    def train(body: str, **arguments: Any) -> Path:
        asked.append(("train", {"body": body, **arguments}))
        return Path(arguments["run_dir"] or "runs/default")

    def evaluate(run: Path, **arguments: Any) -> dict[str, Any]:
        asked.append(("evaluate", {"run": run, **arguments}))
        return RESULT

    def report(run: Path, result: dict[str, Any], **arguments: Any) -> Path:
        asked.append(("report", (run, result)))
        return (arguments.get("out") or run / "report") / "index.html"

    monkeypatch.setattr(training, "train", train)
    monkeypatch.setattr(evaluation, "evaluate", evaluate)
    monkeypatch.setattr(evaluation, "tables", lambda result: [Table("goals", "score")])
    monkeypatch.setattr(viewing, "report", report)
    return asked


def test_help_needs_no_jax() -> None:
    script = (
        "import sys; from everystate.cli import main; code = main(['--help']);"
        "assert not {'jax', 'mujoco', 'flowjax'} & {*sys.modules}; sys.exit(code)"
    )
    shown = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True
    )
    for command in ("train", "evaluate", "demo", "report", "bodies"):
        assert command in shown.stdout


def test_help_of_train_has_every_field_and_the_defaults_of_the_preset(
    capsys: pytest.CaptureFixture,
) -> None:
    with pytest.raises(SystemExit) as stop:
        cli.main(["train", "ramp-pointmass", "--preset", "test", "--help"])
    assert not stop.value.code
    shown = capsys.readouterr().out
    for option in (
        "--seed",
        "--batch-size",
        "--run-dir",
        "--quiet",
        "--p-curric",
        "--no-hindsight",
    ):
        assert option in shown
    assert f"(default: {preset('test').batch_size})" in shown


def test_help_of_train_begins_with_the_run_and_then_has_the_sections_of_the_config(
    capsys: pytest.CaptureFixture,
) -> None:
    with pytest.raises(SystemExit):
        cli.main(["train", "cartpole", "-h"])
    shown = capsys.readouterr().out
    titles = [title for title, names in sections(Config).items() if set(names) - set(FIRST)]
    assert len(titles) == 10
    places = [shown.index(f" {title} options ") for title in titles]
    assert places == sorted(places)
    head, told = shown[: places[0]], [f"--{name.replace('_', '-')} " for name in FIRST[1:]]
    assert [head.index(option) for option in told] == sorted(head.index(option) for option in told)
    assert "Body to learn" in head
    for field in dataclasses.fields(Train):
        option = f"--{field.name}".replace("_", "-")
        listed = re.findall(rf"^\W* {option}[ ,]", shown, re.MULTILINE)
        assert field.name == "body" or len(listed) == 1, field.name


@pytest.mark.parametrize("command", [*cli.COMMANDS])
def test_every_command_explains_itself(command: str, capsys: pytest.CaptureFixture) -> None:
    for help in ("--help", "-h"):
        with pytest.raises(SystemExit) as stop:
            cli.main([command, help])
        assert not stop.value.code
        assert f"everystate {command}" in capsys.readouterr().out


def test_version_is_that_of_the_package(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"everystate {metadata.version('everystate')}\n"


def test_skills_are_listed(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["skills"]) == 0
    shown = capsys.readouterr().out
    assert all(f"{body}:" in shown for body in ("cartpole", "ramp-pointmass", "ant"))
    assert cli.main(["skills", "ant"]) == 0
    assert "cartpole" not in capsys.readouterr().out


def test_train_passes_on_what_was_asked(calls: list[tuple[str, Any]]) -> None:
    arguments = ["--preset", "test", "--seed", "3", "--batch_size=64", "--no-hindsight", "--quiet"]
    assert cli.main(["train", "ramp-pointmass", *arguments, "--run-dir", "here", "--N", "5"]) == 0
    ((_, asked),) = calls
    expected = preset("test", seed=3, batch_size=64, hindsight=False, N=5)
    assert asked.pop("run_dir") == Path("here")
    assert asked.pop("progress") == "plain"
    assert asked.pop("crew") is None
    assert asked.pop("on_epoch") is None
    assert asked.pop("preset") == "test"
    assert preset("test", **asked) == expected


def test_train_takes_the_defaults_of_body_and_preset(calls: list[tuple[str, Any]]) -> None:
    assert cli.main(["train", "cartpole"]) == 0
    ((_, asked),) = calls
    assert (asked["units"], asked["progress"]) == ("running", True)
    assert asked["run_dir"] == Path("runs/cartpole-quick-seed0")
    assert asked["batch_size"] == preset("quick").batch_size


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("trian", "unknown command 'trian': did you mean 'train'?"),
        ("train", "name the body first"),
        ("train ramp-pointmas", "did you mean 'ramp-pointmass'?"),
        ("train ramp-pointmass --preset quik", "did you mean 'quick'?"),
        ("train ramp-pointmass --batchsize 3", "did you mean '--batch-size'?"),
        ("train ramp-pointmass --batchsize=3", "did you mean '--batch-size'?"),
        ("train ramp-pointmass --seed abc", "--seed: invalid literal for int"),
        ("train ramp-pointmass --flow no", "invalid choice 'no' for argument '--flow'"),
        ("train ramp-pointmass --seed", "Missing value for argument '--seed'"),
        ("train ramp-pointmass --preset", "Missing value for argument '--preset'"),
        ("train ramp-pointmass more", "Unrecognized options: more"),
        ("train ramp-pointmass --num-bodies 0", "num_bodies = 0 is out of range"),
        ("train cartpole --body-options wind", "body option 'wind': give name=value"),
        ("train cartpole --body-options wind=3", "cartpole has no option 'wind'"),
        ("train cartpole --body-options mass=heavy", "option mass is 'heavy': expected float"),
        ("train gymnasium:CartPole-v1", "Discrete actions"),
        ("train gymnasium:Nothing-v1", "Environment `Nothing` doesn't exist"),
        ("train nowhere:Nothing-v1", "no module 'nowhere'"),
        ("train nowhere.xml", "no MJCF file nowhere.xml"),
        ("evaluate", "run folder"),
        ("evaluate nowhere", "no agent at nowhere"),
        ("evaluate nowhere --jsn", "did you mean '--json'?"),
        ("bodies --hlp", "unknown option --hlp"),
        ("skills cartpol", "cartpol has no named skills"),
        ("report nowhere", "no agent at nowhere"),
        ("render nowhere", "no agent at nowhere"),
        ("render ramp-pointmass --skill clim", "did you mean 'climb'?"),
        ("render ramp-pointmass --goal 0", "the goal has shape (1,): expected (2,)"),
        ("render ramp-pointmass --goal 0 0 --explore", "give one of --skill, --goal and --explore"),
        ("render ramp-pointmass --out film.avi", "cannot write film.avi"),
        ("render ramp-pointmass --out no/film.mp4", "no is no folder: make it first"),
        ("render ramp-pointmass --plan --no-plan", "give one of --plan and --no-plan"),
        ("render ramp-pointmass --steps 0", "steps is 0: film at least 1"),
        ("render ramp-pointmass --size 481 360", "size 481 x 360: both even"),
    ],
)
def test_a_mistake_is_one_line_and_writes_nothing(
    arguments: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert cli.main(arguments.split()) == 2
    shown = capsys.readouterr()
    assert shown.err.startswith("error: ")
    assert shown.err.count("\n") == 1
    assert said.lower() in shown.err.lower()
    assert shown.out == ""
    assert not list(tmp_path.iterdir())


def test_json_is_the_whole_last_line(
    calls: list[tuple[str, Any]], capsys: pytest.CaptureFixture
) -> None:
    assert cli.main(["evaluate", "runs/x", "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1]) == RESULT
    ((_, asked),) = calls
    assert asked.pop("run") == Path("runs/x")
    assert callable(asked.pop("on_step"))
    wanted = {"suite": None, "split": "report", "plan": False, "episodes": None}
    assert asked == wanted | {"skills": False, "perturb": False}


def test_evaluate_passes_on_what_was_asked(calls: list[tuple[str, Any]]) -> None:
    words = ["--plan", "--episodes", "9", "--split", "tune", "--suite", "rest", "a.json"]
    assert cli.main(["evaluate", "x", *words]) == 0
    ((_, asked),) = calls
    assert asked["suite"] == ("rest", "a.json")
    assert (asked["plan"], asked["episodes"], asked["split"]) == (True, 9, "tune")


def test_demo_trains_evaluates_and_reports(
    calls: list[tuple[str, Any]], capsys: pytest.CaptureFixture
) -> None:
    assert cli.main(["demo", "--preset", "test"]) == 0
    run = Path("runs/ramp-pointmass-demo")
    assert [name for name, _ in calls] == ["train", "evaluate", "report"]
    assert calls[0][1]["run_dir"] == run
    assert calls[0][1]["preset"] == "test"
    assert calls[2][1] == (run, RESULT)
    assert str(run / "report" / "index.html") in capsys.readouterr().out


@pytest.mark.parametrize(("words", "plans"), [([], False), (["--plan"], True)])
def test_report_measures_as_asked_and_names_its_page(
    calls: list[tuple[str, Any]], capsys: pytest.CaptureFixture, words: list[str], plans: bool
) -> None:
    """By the policy unless asked, as the agent itself does not ask for planning."""
    assert cli.main(["report", "ramp-pointmass", "--out", "a", "--episodes", "5", *words]) == 0
    assert capsys.readouterr().out.strip() == "a/index.html"
    assert callable(calls[0][1].pop("on_step"))
    asked = {"run": Path("ramp-pointmass"), "plan": plans, "episodes": 5}
    assert calls == [("evaluate", asked), ("report", (Path("ramp-pointmass"), RESULT))]


def test_an_agent_without_its_run_is_not_measured_for_a_report_that_has_no_place(
    calls: list[tuple[str, Any]], capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    assert cli.main(["report", "cartpole"]) == 2
    assert "cartpole is an agent without its run" in capsys.readouterr().err
    (tmp_path / "file").write_text("mine")
    assert cli.main(["report", "cartpole", "--out", "file"]) == 2
    assert "cannot write to file (File exists)" in capsys.readouterr().err
    assert calls == []


def test_bodies_are_listed(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["bodies"]) == 0
    shown = capsys.readouterr().out
    for text in ("ramp-pointmass: 2 state", "third_party/ant", "every 50 ms", "travel a copy"):
        assert text in shown


def test_a_body_is_described_component_by_component(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["bodies", "cartpole", "gymnasium:Pendulum-v1"]) == 0
    shown = capsys.readouterr().out
    lines = [re.split(r"\s{2,}", line.strip()) for line in shown.splitlines()]
    assert ["state", "unit", "begins at", "scale"] in lines
    (pole,) = (line for line in lines if line[0] == "pole_velocity")
    assert (pole[1], pole[3]) == ("rad/s", "0 ± 5")
    least, most = map(float, pole[2].split(" to "))
    assert -0.3 < least < 0 < most < 0.3
    assert ["cart", "-1 to 1"] in lines
    assert "3 state components, 1 action," in shown
    assert ["action_0", "-2 to 2"] in lines
    assert "travel" not in shown


def test_a_body_of_ones_own_says_what_travels_with_its_run(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "bar.xml").write_text("""
      <mujoco><worldbody><body><joint name="shoulder" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -1" size="0.1"/></body></worldbody></mujoco>
    """)
    (tmp_path / "arm.xml").write_text("""
      <mujoco><include file="bar.xml"/><actuator>
      <motor joint="shoulder" ctrlrange="-3 1" ctrllimited="true"/>
      <motor name="second" joint="shoulder"/></actuator></mujoco>
    """)
    assert cli.main(["bodies", "arm.xml"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "shoulder -3 to 1 second -1 to 1 " in shown
    copied = envs.make("arm.xml", 1, 0).model_hash[:12]
    assert f"copies of arm.xml, bar.xml, and the hash {copied}... of what it compiles to" in shown


@pytest.mark.parametrize(
    ("raised", "code"), [(KeyboardInterrupt(), 130), (EverystateError("a\n  b"), 2)]
)
def test_exit_codes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, raised: BaseException, code: int
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise raised

    monkeypatch.setattr(training, "train", fail)
    assert cli.main(["train", "ramp-pointmass"]) == code
    assert capsys.readouterr().err == ("error: a b\n" if code == 2 else "")


def test_what_is_piped_is_plain_and_fits_a_terminal() -> None:
    words = ["evaluate", "ramp-pointmass", "--episodes", "3"]
    done = subprocess.run([sys.executable, "-m", "everystate", *words], capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")
    lines = done.stdout.decode().splitlines()
    assert any("ledge" in line and "100 %" in line for line in lines)
    assert not any("\x1b" in line or len(line) > 80 for line in lines)


def test_who_stops_reading_is_no_error() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    words = [sys.executable, "-m", "everystate", "--help"]
    done = subprocess.run(words, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, b"")


def test_where_there_is_no_terminal_a_plain_line_says_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    with progress.working("measuring") as count:
        count(1, 2000, 0.25)
    assert capsys.readouterr().err == ""  # not every step
    monkeypatch.setattr(progress, "PERIOD", -1.0)
    clock = iter((100.0, 110.0, 400.0, 401.0))
    monkeypatch.setattr(progress, "monotonic", lambda: next(clock))
    with progress.working("measuring") as count:
        count(1, 2000, 0.25)
        count(1500, 2000, 0.75)
        count(1900, 2000, 0.95)
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines() == [
        "measuring, step 1 of 2,000",  # before it there was much else
        "measuring, step 1,500 of 2,000, about 2 min left",
        "measuring, step 1,900 of 2,000, about 21 s left",
    ]


def test_evaluate_writes_a_raw_file_that_was_not_there(
    calls: list[tuple[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    out = tmp_path / "results" / "one.json"
    assert cli.main(["evaluate", "runs/x", "--out", str(out)]) == 0
    assert raw.check(out)["suites"] == RESULT["suites"]
    assert cli.main(["evaluate", "runs/x", "--out", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert len(calls) == 1  # nothing was measured for nothing
