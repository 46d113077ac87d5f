"""What is not finite is found where it arises, kept, and changes no model."""

import functools
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import everystate
from everystate import envs
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.learning.state import AgentState
from everystate.presets import preset
from everystate.training import faults, loop
from everystate.training.collection import warm_up
from everystate.training.groups import Groups, InProcess
from everystate.training.learner import Learner, compiled
from everystate.training.logging import read_metrics

BODY = "ramp-pointmass"
STOPS: dict[str, Any] = {"not_finite": "stop", "dynamics_updates": 1}
"""With one batch an update, so that the bad transition is in some of them."""


def poisoned(state: AgentState, value: float, *, count: int = 3) -> AgentState:
    """Some of its 300 or so transitions are no longer true."""
    ring = state.replay.transitions
    spoilt = ring._replace(actions=ring.actions.at[7 : 7 + count].set(value))
    return state._replace(replay=state.replay._replace(transitions=spoilt))


def warmed_up(config: Config) -> AgentState:
    env = envs.make(BODY, config.num_bodies, 0)
    groups = Groups(config, InProcess(compiled(config), env), lambda: False)
    snapshot = warm_up(config, env, groups)
    assert snapshot is not None
    return snapshot.agent


@functools.cache
def epoch(mode: Literal["stop", "roll-back"], value: float) -> tuple[Any, ...]:
    config = preset("test", not_finite=mode, dynamics_updates=1)
    state = warmed_up(config)
    before = state.models
    models = jax.tree.map(lambda x: x.copy() if isinstance(x, jax.Array) else x, before)
    state, metrics, fault = compiled(config).update(poisoned(state, value))
    return models, state, {name: float(x) for name, x in metrics.items()}, fault


def all_finite(models: Any) -> bool:
    arrays = everystate.agent.named_arrays(models).values()
    return all(np.isfinite(x).all() for x in arrays)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e30])
def test_an_update_that_is_not_finite_changes_no_model(value: float) -> None:
    _, state, metrics, fault = epoch("roll-back", value)
    assert all_finite(state.models)
    assert 0 < metrics["update/taken"] < 1, "some batches have the bad transition, others not"
    assert faults.not_finite(metrics) == []
    assert fault.update >= 0
    actions = np.asarray(fault.batch.minibatch.transitions.actions)
    assert np.any(np.isnan(actions) if np.isnan(value) else actions == value)


def test_after_the_first_of_them_a_run_that_stops_learns_nothing() -> None:
    _, state, metrics, fault = epoch("stop", float("nan"))
    assert all_finite(state.models)
    assert metrics["update/taken"] == pytest.approx(int(fault.update) / 10)
    assert not np.isfinite(fault.metrics["loss/d"])


def test_without_a_fault_there_is_none() -> None:
    before, state, metrics, fault = epoch("stop", 0.5)
    assert int(fault.update) == -1
    assert metrics["update/taken"] == 1
    changed = everystate.agent.named_arrays(state.models)
    same = [
        np.array_equal(x, changed[name])
        for name, x in everystate.agent.named_arrays(before).items()
    ]
    assert not all(same)


def test_weights_stay_finite_where_densities_are_not() -> None:
    config = preset("test")
    state = warmed_up(config)
    from everystate.learning import replay as rb

    minibatch = rb.sample(
        config, state.replay, state.models.dynamics.change_scale, key=jax.random.key(0)
    )
    bad = jnp.full(config.batch_size, jnp.nan)
    after = rb.refresh(config, state.replay, minibatch, bad, -bad)
    assert np.array_equal(after.goals.log, state.replay.goals.log)
    few = jax.tree.map(lambda x: x[:3], state.replay.transitions)
    added = rb.add(config, state.replay, few, jnp.array([jnp.inf, 0.0, jnp.nan]), jnp.zeros(3))
    assert np.isfinite(added.goals.groups).all()
    assert not np.isnan(added.goals.log).any()


def spoiling(config: Any, after: int) -> Learner:
    """The learner, in whose memory a transition is spoilt after an epoch."""
    learner = compiled(config)

    def observe(state: AgentState, steps: Any) -> AgentState:
        state = learner.observe(state, steps)
        return poisoned(state, float("nan"), count=10) if int(state.epoch) == after else state

    return learner._replace(observe=observe)


def test_a_run_stops_names_what_was_wrong_and_keeps_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "compiled", functools.partial(spoiling, after=1))
    run = tmp_path / "run"
    with pytest.raises(
        EverystateError,
        match=r"in epoch 2, update \d+: loss/d is (nan|inf), .*"
        r"its input minibatch.transitions.actions is nan in row \d+, component 0\. Batch and"
        r".* The last good checkpoint is kept in",
    ):
        everystate.train(BODY, preset="test", run_dir=run, progress=False, **STOPS)
    assert [line["epoch"] for line in read_metrics(run)] == [1]
    assert [p.name for p in (run / "checkpoints").iterdir()] == ["000001"]
    with np.load(run / "faults" / "000002" / "batch.npz") as batch:
        assert np.isnan(batch["minibatch.transitions.actions"]).any()
    assert all_finite(everystate.load(run / "faults" / "000002").models)

    monkeypatch.undo()
    everystate.train(BODY, preset="test", run_dir=run, progress=False, **STOPS)
    assert [line["epoch"] for line in read_metrics(run)] == [1, 2, 3]


def test_a_run_that_stops_at_once_promises_no_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "compiled", functools.partial(spoiling, after=0))
    with pytest.raises(EverystateError, match=r"in epoch 1, .* There was no checkpoint yet"):
        everystate.train(BODY, preset="test", run_dir=tmp_path / "run", progress=False, **STOPS)


def test_a_run_can_go_on_without_such_updates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(loop, "compiled", functools.partial(spoiling, after=1))
    run = tmp_path / "run"
    everystate.train(BODY, preset="test", run_dir=run, progress="plain", dynamics_updates=1)
    taken = [line["update/taken"] for line in read_metrics(run)]
    assert taken[0] == 1
    assert all(0 < share < 1 for share in taken[1:])
    assert "left out in epoch 2, update" in capsys.readouterr().out
    assert all_finite(everystate.load(run).models)


def test_inputs_that_are_finite_are_told_by_their_size() -> None:
    batch = {"a": np.array([1.0, -3e8]), "slots": np.array([10**12]), "none": np.empty((2, 0))}
    assert faults._input(batch) == "its inputs are finite, the largest is 3e+08 in a"
    assert faults._input({"a": np.array([1.0, np.inf])}) == "its input a is inf in row 1"
