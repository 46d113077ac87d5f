"""A slow body learns over several control steps at a time [D47]."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import everystate
from everystate.config import Config
from everystate.presets import preset
from everystate.training.bodies import make_bodies
from everystate.training.interval import fitting, with_interval

RNG = np.random.default_rng(0)
NEVER = np.zeros((2000, 4), dtype=bool)


def waves(*periods: float) -> np.ndarray:
    """A component per period, in steps, each body at another phase."""
    phase = RNG.uniform(0, 2 * np.pi, (4, len(periods)))
    angle = np.arange(2001)[:, None, None] / np.array(periods) * 2 * np.pi + phase
    return np.sin(angle)


def change(period: float, steps: int) -> float:
    """Of a sine, root mean square, in its standard deviations."""
    return 2 * abs(np.sin(np.pi * steps / period))


@pytest.mark.parametrize("period", [100.0, 200.0, 400.0])
def test_every_component_changes_by_a_twelfth_of_its_spread(period: float) -> None:
    found = fitting(waves(period, period / 2), NEVER)
    assert change(period, found) >= 0.95 / 12
    assert change(period, found - 1) < 1.05 / 12


def test_but_none_by_more_than_a_half() -> None:
    found = fitting(waves(2000.0, 40.0), NEVER)
    assert change(40.0, found) <= 0.5 < change(40.0, found + 1)
    assert fitting(waves(2000.0, 4.0), NEVER) == 1


def test_units_and_what_is_told_twice_or_never_changes_say_nothing() -> None:
    states = waves(300.0, 150.0)
    more = [1e3 * states[..., :1] + 7, *[states[..., 1:]] * 5, np.full_like(states[..., :1], 3.0)]
    assert fitting(np.concatenate(more, axis=-1), NEVER) == fitting(states, NEVER) > 1
    assert fitting(np.ones((2001, 4, 1)), NEVER) == 1
    assert fitting(np.full((2001, 4, 1), np.nan), NEVER) == 1


def test_where_a_body_is_put_elsewhere_nothing_moved() -> None:
    states, ended = waves(300.0), NEVER.copy()
    jumped = states.copy()
    for step in range(10, 2000, 10):
        ended[step - 1] = True
        jumped[step:] = np.roll(jumped[step:], 1, axis=1)
    assert fitting(jumped, ended) == pytest.approx(fitting(states, NEVER), abs=1)


def slow(**fields: object) -> Config:
    """The test preset of a body that takes short steps, the interval to be measured."""
    return preset("test", "pendulum.xml", interval=0, evaluation_period=0, **fields)


MODEL = """<mujoco><option timestep="{step}"/><worldbody><body><joint name="arm" axis="0 1 0"
 damping=".05"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 .5"/></body></worldbody>
<actuator><motor joint="arm" gear="2" ctrlrange="-1 1" ctrllimited="true"/></actuator></mujoco>"""


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("pendulum.xml").write_text(MODEL.format(step=0.002))


def timeless(run: Path) -> list[dict[str, float]]:
    lines = map(json.loads, (run / "metrics.jsonl").read_text().splitlines())
    return [{k: x for k, x in line.items() if not k.startswith("time/")} for line in lines]


@pytest.mark.usefixtures("model")
def test_a_run_measures_keeps_and_tells_in_control_steps(capsys: pytest.CaptureFixture) -> None:
    options = ("frame_skip=1",)
    config = slow(epochs=2, body_options=options)
    run = everystate.train(config, run_dir="run", progress="plain")
    interval = json.loads((run / "config.json").read_text())["config"]["interval"]
    assert interval > 1
    assert f"learning over {interval} control steps at a time" in capsys.readouterr().out
    assert interval == with_interval(config, Path("elsewhere")).interval
    lines = timeless(run)
    of_epoch = config.num_bodies * config.steps_per_epoch * interval
    assert lines[1]["steps"] - lines[0]["steps"] == of_epoch
    # What is there decides, whatever would be measured now.
    assert with_interval(slow(seed=5, body_options=options), run).interval == interval
    more = slow(epochs=3, body_options=options)
    assert everystate.train(more, run_dir="run", progress=False) == run
    assert timeless(run) == timeless(everystate.train(more, run_dir="straight", progress=False))

    agent = everystate.load(run)
    goal = agent.propose_goals(5)
    one = replace(agent, config=replace(agent.config, interval=1))
    for ask in ("steps_to_goal", "value"):
        told, of_one = getattr(agent, ask)(goal[0], goal), getattr(one, ask)(goal[0], goal)
        np.testing.assert_allclose(told, interval * of_one, rtol=1e-5)


@pytest.mark.usefixtures("model")
def test_a_step_of_a_run_is_as_many_control_steps() -> None:
    actions = RNG.uniform(-1, 1, (3, 1)).astype(np.float32)
    config = slow(body_options=("frame_skip=1",))
    several, single = (make_bodies(replace(config, interval=n), 3) for n in (4, 1))
    for env in (several, single):
        env.reset(seed=0)
    reached = [single.step(actions)[0] for _ in range(4)]
    np.testing.assert_array_equal(several.step(actions)[0], reached[-1])
