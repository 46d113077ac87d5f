"""An agent in one file, and on a hub, is the same agent; what is no such file is one clear line."""

import dataclasses
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from everystate import cli, envs
from everystate.agent import Agent, load, sharing, with_model_copy
from everystate.errors import EverystateError

HERE, THERE = [-0.8, -0.8], [0.0, 0.8]
ARM = """<mujoco><worldbody><body><joint name="hip"/><geom size="1"/></body></worldbody>
<actuator><motor joint="hip"/></actuator></mujoco>"""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EVERYSTATE_CACHE", str(tmp_path / "cache"))
    return tmp_path


@pytest.fixture(scope="module")
def agent() -> Agent:
    return load("ramp-pointmass")


def test_an_agent_in_one_file_is_the_same(agent: Agent, elsewhere: Path) -> None:
    (elsewhere / "arm.xml").write_text(ARM)
    envs.copy_model(Path("arm.xml"), elsewhere / "body")
    own = with_model_copy(dataclasses.replace(agent.config, body="arm.xml"), elsewhere / "body")
    packed = dataclasses.replace(agent, config=own).export("deep/arm.zip")
    names = ["agent.json", "agent.safetensors", "body/arm.xml", "body/body.json"]
    files = (name for name in zipfile.ZipFile(packed).namelist() if not name.endswith("/"))
    assert sorted(files) == names
    assert [path.name for path in Path("deep").iterdir()] == ["arm.zip"]
    moved = packed.rename("moved.zip")
    (elsewhere / "arm.xml").unlink()
    first, again = load(moved), load(moved)
    np.testing.assert_array_equal(first.act(HERE, THERE), agent.act(HERE, THERE))
    assert again.config == first.config
    (option,) = first.config.body_options
    assert (Path(option.partition("=")[2]) / "arm.xml").read_text() == ARM
    with pytest.raises(EverystateError, match=r"moved\.zip exists already"):
        agent.export(moved)


def test_export_makes_a_folder_or_a_file_to_share(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["export", "ramp-pointmass", "ramp"]) == 0
    assert cli.main(["export", "ramp", "ramp.zip", "--half"]) == 0
    assert capsys.readouterr().out.split() == ["ramp", "ramp.zip"]
    assert load("ramp.zip").config == load("ramp").config
    assert Path("ramp.zip").stat().st_size < 0.7 * Path("ramp/agent.safetensors").stat().st_size


def test_a_name_that_leads_out_of_an_archive_is_kept_inside(elsewhere: Path) -> None:
    with zipfile.ZipFile("evil.zip", "w") as archive:
        archive.writestr("../../../../out", "evil")
        archive.writestr(f"{elsewhere}/out", "evil")
    with pytest.raises(EverystateError, match="holds no agent"):
        load("evil.zip")
    assert not (elsewhere / "out").exists()
    assert not (elsewhere.parent / "out").exists()


def test_what_is_no_archive_is_named(
    agent: Agent, elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = agent.export("whole.zip").read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 255
    for content in (b"", b"no archive", whole[:-100], bytes(flipped)):
        Path("other.zip").write_bytes(content)
        with pytest.raises(EverystateError, match=r"other\.zip is no agent in one file"):
            load("other.zip")
    monkeypatch.setattr(sharing, "LIMIT", 1000)
    with pytest.raises(EverystateError, match="more than 1000"):
        load("whole.zip")
    assert not list((elsewhere / "cache" / "agents").iterdir())


def test_an_agent_on_the_hub_is_found_by_its_name(
    agent: Agent, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a stand-in for the hub's client, which has it in a folder."""
    asked: list[Any] = []

    def snapshot_download(repo: str, *, revision: str | None, allow_patterns: list[str]) -> str:
        asked.append((repo, revision, allow_patterns))
        if repo != "me/ramp":
            raise ConnectionError("no such\nagent")
        return str(folder)

    folder = agent.export("on-the-hub")
    hub = SimpleNamespace(snapshot_download=snapshot_download)
    monkeypatch.setitem(sys.modules, "huggingface_hub", hub)  # pyright: ignore
    for name in ("hf:me/ramp", "hf:me/ramp@v2"):
        np.testing.assert_array_equal(load(name).act(HERE, THERE), agent.act(HERE, THERE))
    files = ["agent.json", "agent.safetensors", "body/*"]
    assert asked == [("me/ramp", None, files), ("me/ramp", "v2", files)]
    with pytest.raises(EverystateError, match="cannot get hf:you/ramp from the hub: no such agent"):
        load(Path("hf:you/ramp"))
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)  # pyright: ignore
    with pytest.raises(EverystateError, match="pip install huggingface_hub"):
        load("hf:me/ramp")
