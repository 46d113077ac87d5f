"""The programs in examples/ do what they say."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from everystate import cli

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_the_cartpole_swings_up_without_jax(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["export", "cartpole", "policy.npz"]) == 0
    script = f"""
import runpy, sys
runpy.run_path({str(EXAMPLES / "run_without_jax.py")!r})
ours = {{name for name in sys.modules if name.startswith("everystate")}}
assert ours == {{"everystate", "everystate.errors", "everystate.portable"}}
assert not {{"jax", "equinox", "onnx", "gymnasium"}} & set(sys.modules)
"""
    said = subprocess.run(
        [sys.executable, "-c", script, "policy.npz"], capture_output=True, text=True
    )
    assert said.returncode == 0, said.stderr
    degrees, centimetres = (float(x) for x in re.findall(r": ([\d.]+) ", said.stdout))
    assert degrees < 5
    assert centimetres < 20


@pytest.mark.peers
def test_ppo_learns_over_an_agent(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """That it runs: too few goals to learn anything."""
    program = EXAMPLES / "over_an_agent.py"
    monkeypatch.setattr(sys, "argv", [str(program), "50"])
    runpy.run_path(str(program))
    said = capsys.readouterr().out
    assert len(re.findall(r"\d+ before practice, \d+ after", said)) == 2
