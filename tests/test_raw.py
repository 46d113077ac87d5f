"""A raw result says where it comes from, and an edit of it is noticed."""

import json
from pathlib import Path

import pytest

from everystate.errors import EverystateError
from everystate.evaluation import raw

RESULT = {"success": [0.1, 1 / 3, 1e-300], "seed": 0, "name": "größer"}


def test_what_is_written_is_checked_and_read_again(tmp_path: Path) -> None:
    path = tmp_path / "study" / "seed0.json"
    raw.write(path, RESULT)
    content = raw.check(path)
    assert {name: content[name] for name in RESULT} == RESULT
    assert {*content} == {*RESULT, *raw.HEADER, "sha256"}
    assert list(path.parent.iterdir()) == [path]


def test_a_field_of_the_header_that_the_result_has_is_kept(tmp_path: Path) -> None:
    raw.write(tmp_path / "a.json", RESULT | {"commit": "abc"})
    assert raw.check(tmp_path / "a.json")["commit"] == "abc"


@pytest.mark.parametrize("name", ["success", "command", "clean", "date"])
def test_an_edit_is_noticed(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    raw.write(path, RESULT)
    path.write_text(json.dumps(json.loads(path.read_text()) | {name: "another"}))
    with pytest.raises(EverystateError, match="changed after it was written"):
        raw.check(path)


@pytest.mark.parametrize("name", [*raw.HEADER, "sha256"])
def test_a_missing_field_is_noticed(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    raw.write(path, RESULT)
    content = json.loads(path.read_text())
    del content[name]
    path.write_text(json.dumps(content))
    with pytest.raises(EverystateError, match=f"lacks {name}"):
        raw.check(path)


def test_another_result_is_not_overwritten_unless_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    raw.write(path, RESULT)
    before = path.read_bytes()
    raw.write(path, RESULT)
    with pytest.raises(EverystateError, match="holds another result"):
        raw.write(path, RESULT | {"seed": 1})
    assert path.read_bytes() == before
    raw.write(path, RESULT | {"seed": 1}, replace=True)
    assert raw.check(path)["seed"] == 1


def test_an_edited_file_is_not_taken_for_the_same_result(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    raw.write(path, RESULT)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"command": "another"}))
    with pytest.raises(EverystateError, match="holds another result"):
        raw.write(path, RESULT)


def test_what_is_too_large_or_no_json_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EverystateError, match="at most 1,000,000 are kept"):
        raw.write(tmp_path / "a.json", {"states": [0.123456789] * 100_000})
    with pytest.raises(EverystateError, match="no JSON"):
        raw.write(tmp_path / "a.json", {"success": float("nan")})
    assert not list(tmp_path.iterdir())
