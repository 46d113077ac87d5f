"""The notebook does what it says: its cells are run, in order."""

import json
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

NOTEBOOK = Path(__file__).parents[1] / "examples" / "quickstart.ipynb"


def test_the_quickstart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    left: dict[str, Any] = {}
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "what an older version printed"
            exec(compile("".join(cell["source"]), cell["id"], "exec"), left)
    plt.close("all")
    assert left["states"][-1][1] > 0.95  # the cosine of the pole's angle
    assert len(left["reached"]) == 3
    assert Path("quickstart-agent.zip").exists()
