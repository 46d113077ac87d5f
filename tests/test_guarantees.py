"""The page of guarantees names tests, programs and results that are there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "guarantees.md").read_text()


def test_every_file_it_names_is_there() -> None:
    files = {f"tests/{name}" for name in re.findall(r"`(test_\w+\.py)", PAGE)}
    files |= set(re.findall(r"(?:tests|tools|results)/[\w/-]+\.\w+", PAGE))
    assert len(files) > 20
    assert sorted(name for name in files if not (ROOT / name).exists()) == []


def test_every_test_it_names_is_there() -> None:
    named = re.findall(r"`(test_\w+\.py): (test_\w+)`", PAGE)
    assert len(named) >= 2
    for file, name in named:
        assert f"def {name}(" in (ROOT / "tests" / file).read_text(), name
