"""Training, resuming, evaluating and reporting, on one body of each kind and a few seconds each."""

import dataclasses
import shutil
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import everystate
from everystate import evaluation, viewing
from everystate.learning.models import Space
from everystate.training.logging import read_metrics

SHORT: dict[str, Any] = {
    "preset": "test",
    "epochs": 2,
    "num_updates": 5,
    "width": 8,
    "depth": 1,
    "state_layers": 1,
    "curriculum_layers": 1,
    "frequencies": 1,
    "progress": False,
}


def timeless(run: Path) -> list[dict[str, Any]]:
    """A run's metrics without what depends on the clock."""
    return [
        {name: x for name, x in line.items() if not name.startswith("time")}
        for line in read_metrics(run)
    ]


@pytest.mark.parametrize(
    "body",
    [
        "cartpole",
        "ant",
        pytest.param("gymnasium:Pendulum-v1", marks=pytest.mark.slow),
        pytest.param("gymnasium:Ant-v5", marks=pytest.mark.slow),
    ],
)
def test_trains_resumes_evaluates_and_reports(body: str, tmp_path: Path) -> None:
    run = everystate.train(body, run_dir=tmp_path / "run", **SHORT)
    whole = timeless(run)
    assert len(whole) == 2

    killed = tmp_path / "killed"
    shutil.copytree(run, killed)
    shutil.rmtree(killed / "checkpoints" / "000002")
    everystate.train(body, run_dir=killed, **SHORT)
    assert timeless(killed) == whole

    result = evaluation.evaluate(run, plan=True, episodes=8)
    assert result["body"] == body
    assert {suite["tasks"] for suite in result["suites"].values()} == {8}
    again = evaluation.evaluate(killed, plan=True, episodes=8)
    assert again["suites"] == result["suites"], "the agents are the same, and so is what they do"
    if body in ("cartpole", "gymnasium:Pendulum-v1"):
        placeable = body == "cartpole"
        assert ("only live" in viewing.report(run, result).read_text()) != placeable
        assert (run / "report" / "film.gif").exists() == placeable


def test_options_of_a_body_are_kept_with_its_agent(tmp_path: Path) -> None:
    options = ("mass=2.0", "action_noise=0.1")
    run = everystate.train("cartpole", run_dir=tmp_path / "run", body_options=options, **SHORT)
    agent = everystate.load(run)
    assert agent.config.body_options == options
    found = evaluation.evaluate(run, suite="rest")["suites"]["rest"]["policy"]["closest"]
    plain = dataclasses.replace(agent.config, body_options=())
    elsewhere = dataclasses.replace(agent, config=plain)
    light = evaluation.evaluate(elsewhere, suite="rest")["suites"]["rest"]["policy"]["closest"]
    assert found != light, "it was measured on the body that it learned"


class Corridor(gymnasium.Env):
    """A place x that ends at 1, from where one starts again at 0."""

    observation_space = gymnasium.spaces.Box(-10.0, 10.0, (1,))
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))
    render_mode = None

    def __init__(self, render_mode: str | None = None) -> None:
        self.x = 0.0

    def _seen(self) -> np.ndarray:
        return np.array([self.x], dtype=np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:
        self.x = 0.0
        return self._seen(), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict]:
        self.x += 0.4 * float(action[0])
        return self._seen(), 0.0, self.x > 1.0, False, {}


def test_nothing_is_learned_across_an_end(tmp_path: Path) -> None:
    """No transition leads from beyond 1 back to 0: every step is at most 0.4 long."""
    entry: Any = Corridor
    gymnasium.register("Corridor-v0", entry)
    run = everystate.train("gymnasium:Corridor-v0", run_dir=tmp_path / "run", **SHORT)
    del gymnasium.registry["Corridor-v0"]
    from everystate.presets import preset
    from everystate.training import checkpoint

    fields = {name: x for name, x in SHORT.items() if name not in ("preset", "progress")}
    config = preset("test", "gymnasium:Corridor-v0", **fields)
    snapshot = checkpoint.restore(run / "checkpoints", config, Space(1, 1))
    assert snapshot is not None
    replay, scale = snapshot.agent.replay, snapshot.agent.scale
    filled = int(replay.size)
    before, after = (
        np.asarray(scale.unscaled(x))[:filled, 0]
        for x in (replay.transitions.observations, replay.transitions.next_observations)
    )
    assert np.abs(after - before).max() < 0.41
    assert after.max() > 1.0
    assert before.max() <= 1.0 + 1e-5
