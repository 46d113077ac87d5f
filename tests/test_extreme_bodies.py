"""Scales, constants, jumps and copies that numbers break on: training stays finite."""

from pathlib import Path

import numpy as np
import pytest

import everystate
from everystate.training import faults
from everystate.training.logging import read_metrics
from extreme_bodies import OBSERVED

FAST = ("Jumping",)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in FAST else pytest.mark.slow) for n in OBSERVED]
)
def test_an_extreme_body_trains_without_a_fault(tmp_path: Path, name: str) -> None:
    run = everystate.train(
        f"extreme_bodies:{name}-v0", preset="test", run_dir=tmp_path / "run", progress=False
    )
    metrics = read_metrics(run)
    assert [line["epoch"] for line in metrics] == [1, 2, 3]
    assert all(line["update/taken"] == 1 for line in metrics)
    assert all(faults.not_finite(line) == [] for line in metrics)
    agent = everystate.load(run)
    goals = agent.propose_goals(5)
    assert np.isfinite(goals).all()
