"""Tables in documents are those that raw files make."""

import importlib
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from everystate.presets import preset

TOOLS = Path(__file__).parents[1] / "tools"


@pytest.fixture
def cells(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(TOOLS))
    found = importlib.import_module("table_cells")
    monkeypatch.setattr(found, "TABLES", {"two": lambda: [["a", "b"], ["1", "2"]]})
    return found


def test_the_documents_hold_what_the_raw_files_say() -> None:
    words = [sys.executable, str(TOOLS / "tables.py"), "--check"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_stale_table_is_named_and_written_anew(cells: Any, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("x\n\n<!-- table: two -->\n| a | b |\n| 1 | 3 |\n<!-- end -->\n\ny\n")
    text, stale = cells.rewrite(page)
    assert stale == ["two"]
    table = "| a | b |\n| --- | --- |\n| 1 | 2 |\n"
    assert text == f"x\n\n<!-- table: two -->\n{table}<!-- end -->\n\ny\n"
    page.write_text(text)
    assert cells.rewrite(page) == (text, [])


def test_an_unknown_table_is_an_error(cells: Any, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- table: three -->\n<!-- end -->\n")
    with pytest.raises(SystemExit, match="no table 'three'"):
        cells.rewrite(page)


def test_cells_have_the_median_and_its_interval(cells: Any) -> None:
    assert cells.middle([0.1, 1.0, 0.15]) == "15"
    assert cells.middle([]) == cells.NONE
    assert cells.interval([0.5, 0.5, 0.5]) == "50 [50, 50]"
    assert cells.values([{"a": {"b": 1.0}}, {"a": None}], "a", "b") == [1.0]


def test_every_departure_has_a_row(cells: Any) -> None:
    departures = importlib.import_module("table_departures")
    configs = [asdict(preset(name)) for name in departures._PRESETS]
    differing = {name for name in configs[0] if len({repr(c[name]) for c in configs}) > 1}
    told = [name for names in departures._DEPARTURES.values() for name in names]
    assert sorted(told) == sorted(differing)
