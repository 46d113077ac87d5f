"""A run's config as TOML: what a run writes can be given back, and the command line counts more."""

import dataclasses
import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as some

from everystate import cli, config_file, training
from everystate.agent import BodyInfo
from everystate.config import MODEL_COPY, Config
from everystate.presets import PRESETS, preset
from everystate.training.rundir import open_run


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What `everystate train` asks for; nothing is trained."""
    found: dict[str, Any] = {}

    def train(body: str, **how: Any) -> Path:
        found.update(how, body=body)
        return Path("run")

    monkeypatch.setattr(training, "train", train)
    return found


def config_of(asked: dict[str, Any]) -> Config:
    names = {field.name for field in dataclasses.fields(Config)}
    return Config(**{name: x for name, x in asked.items() if name in names})


@pytest.mark.parametrize("name", PRESETS)
def test_the_file_of_a_run_gives_its_config_again(name: str, asked: dict[str, Any]) -> None:
    config = preset(name, "cartpole", seed=3, body_options=("mass=2",), patience=7)
    copied = dataclasses.replace(config, body_options=("mass=2", f"{MODEL_COPY}=/tmp/x"))
    with open_run(Path("run"), copied, BodyInfo(("x",), 1)):
        pass
    assert cli.main(["train", "--config", "run/config.toml"]) == 0
    assert config_of(asked) == config
    assert asked["run_dir"] == Path("runs/cartpole-config-seed3")


def test_a_file_may_set_little_and_the_command_line_counts_more(asked: dict[str, Any]) -> None:
    Path("mine.toml").write_text(
        'body = "cartpole"\npreset = "test"\nseed = 4\nepochs = 9\nweight_clip = inf\n'
    )
    assert cli.main(["train", "--config", "mine.toml", "--seed", "5"]) == 0
    expected = preset("test", "cartpole", seed=5, epochs=9, weight_clip=math.inf)
    assert config_of(asked) == expected
    assert asked["run_dir"] == Path("runs/cartpole-mine-seed5")
    assert cli.main(["train", "ant", "--config=mine.toml", "--preset", "quick"]) == 0
    expected = preset("quick", "ant", seed=4, epochs=9, weight_clip=math.inf)
    assert config_of(asked) == expected
    assert cli.main(["train", "ant", "--config", "mine.toml", "--run-dir", "here"]) == 0
    assert asked["run_dir"] == Path("here")


@pytest.mark.parametrize(
    ("text", "words", "said"),
    [
        ("seed = ", "", "mine.toml cannot be read as a config"),
        ("seed = 1", "", "name the body first"),
        ("body = 3", "", "body = 3 is not of type str"),
        ('body = "ant"\npreset = 1', "", "preset = 1 is not of type str"),
        ('body = "ant"\nsede = 1', "", "mine.toml: unknown field 'sede': did you mean 'seed'?"),
        ('body = "ant"\nseed = -1', "", "mine.toml: seed = -1 is out of range"),
        ('body = "ant"', "--seed 1 cartpole", "name the body first: everystate train cartpole"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_file(
    text: str, words: str, said: str, asked: dict[str, Any], capsys: pytest.CaptureFixture
) -> None:
    Path("mine.toml").write_text(text)
    assert cli.main(["train", "--config", "mine.toml", *words.split()]) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1
    assert not asked


def test_a_file_that_is_not_there_is_a_mistake(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["train", "--config", "no.toml"]) == 2
    assert "no.toml cannot be read as a config" in capsys.readouterr().err


@given(
    some.dictionaries(
        some.from_regex(r"[a-zA-Z_]+", fullmatch=True),
        some.booleans()
        | some.integers(-(2**63), 2**63 - 1)
        | some.floats(allow_nan=False)
        | some.text(some.characters(exclude_categories=["Cs"]))
        | some.lists(some.text(some.characters(exclude_categories=["Cs"]))),
    )
)
def test_any_value_comes_back(fields: dict[str, Any]) -> None:
    assert tomllib.loads(config_file.text(fields)) == fields


def test_a_name_that_is_no_text_can_be_written() -> None:
    assert tomllib.loads(config_file.text({"body": "a\udcff.xml"})) == {"body": "a?.xml"}
