"""The training loop: resumes bit for bit, loses nothing, refuses what is not its own.

Most tests learn nothing: a stand-in learner leaves the loop its schedule. Two train for real.
"""

import functools
import importlib
import itertools
import json
import logging
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import safetensors.numpy

import everystate
from everystate import envs
from everystate.agent import named_arrays
from everystate.errors import EverystateError
from everystate.learning.draws import Draws
from everystate.learning.guard import Fault
from everystate.learning.models import Space
from everystate.presets import preset
from everystate.training import checkpoint, loop, train
from everystate.training.learner import Learner
from everystate.training.logging import Log, read_metrics, shown

BODY = "ramp-pointmass"
CONFIG = preset("test")
quietly: Callable[..., Path] = functools.partial(train, BODY, preset="test", progress=False)


def idle(on_act: Callable[[int], None] = lambda step: None, loss: float = 1.0) -> Learner:
    """A learner that stands still, and learns nothing."""
    step = itertools.count()

    def act(actor, episodes, draws, observations):
        on_act(next(step))
        return episodes, jnp.zeros(observations.shape)

    def update(state):
        metrics = {"loss/f": jnp.float32(loss), "episode/reached": jnp.float32(0.5)}
        return state._replace(epoch=state.epoch + 1), metrics, Fault(jnp.int32(-1), batch, {})

    zeros = jnp.zeros((CONFIG.steps_per_epoch, CONFIG.num_bodies, 2))
    draws = Draws(zeros, zeros, zeros[..., 0].astype(int))
    batch: Any = None
    return Learner(lambda state: draws, act, lambda state, steps: state, update)


@pytest.fixture
def no_learning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "compiled", lambda config: idle())


def timeless(run: Path) -> list[dict[str, Any]]:
    """A run's metrics without what depends on the clock."""
    return [
        {name: x for name, x in line.items() if not name.startswith("time")}
        for line in read_metrics(run)
    ]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def checkpoints(run: Path) -> list[str]:
    return sorted(path.name for path in (run / "checkpoints").iterdir())


# --- For real ---


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[int]]:
    """A run of four epochs, and how many programs had been compiled by the end of each."""
    counts, compiled = [], []

    class Counter(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.getMessage().startswith("Compiling"):
                compiled.append(record.getMessage()[:200])

    def epoch(self: Log, metrics: dict[str, int | float]) -> bool:
        counts.append(len(compiled))
        return write(self, metrics)

    write, logger, counter = Log.epoch, logging.getLogger("jax"), Counter()
    logger.addHandler(counter)
    try:
        with pytest.MonkeyPatch.context() as patch, jax.log_compiles():
            patch.setattr(Log, "epoch", epoch)
            run = tmp_path_factory.mktemp("runs") / "trained"
            quietly(run_dir=run, epochs=4, checkpoint_period=2)
    finally:
        logger.removeHandler(counter)
    return run, counts


def test_nothing_is_compiled_after_the_first_epoch(trained: tuple[Path, list[int]]) -> None:
    """Between the second and the third, the first checkpoint may have needs of its own."""
    _, counts = trained
    assert counts[0] > 0, "compiling went unseen"
    assert counts[1] == counts[0]
    assert counts[3] == counts[2]


def test_an_interrupted_run_ends_as_if_it_had_not_been(
    trained: tuple[Path, list[int]], tmp_path: Path
) -> None:
    """Killed after its last epoch was logged and before it was saved; resumed elsewhere."""
    straight, _ = trained
    resumed = tmp_path / "resumed"
    shutil.copytree(straight, resumed)
    shutil.rmtree(resumed / "checkpoints" / "000004")
    (resumed / "samples" / "000004.npz").unlink()
    with (resumed / "metrics.jsonl").open("a") as file:
        file.write('{"epoch": 5, "cut sho')
    script = (
        f"import everystate; everystate.train({BODY!r}, preset='test', progress=False,"
        f" run_dir={str(resumed)!r}, epochs=4, checkpoint_period=2)"
    )
    subprocess.run([sys.executable, "-c", script], check=True)

    assert timeless(resumed) == timeless(straight)
    assert [line["epoch"] for line in read_metrics(resumed)] == [1, 2, 3, 4]
    config = preset("test", BODY, epochs=4, checkpoint_period=2)
    ends = [
        checkpoint.restore(run / "checkpoints", config, Space(2, 2)) for run in (straight, resumed)
    ]
    first, second = (
        named_arrays(end._replace(agent=end.agent._replace(key=jax.random.key_data(end.agent.key))))
        for end in ends
        if end is not None
    )
    assert first.keys() == second.keys()
    for name in first:
        assert np.asarray(first[name]).tobytes() == np.asarray(second[name]).tobytes(), name
    for run in (straight, resumed):
        assert (run / "samples" / "000004.npz").exists()
    assert contents(straight)["samples/000004.npz"] == contents(resumed)["samples/000004.npz"]


@pytest.mark.slow
def test_a_run_that_is_compiled_as_users_do_is_resumed_bit_for_bit(
    tmp_path: Path, as_users: dict[str, str]
) -> None:
    """Other tests leave most optimisations out, and check types."""
    straight, resumed = tmp_path / "straight", tmp_path / "resumed"
    script = (
        "import sys; import jax; import everystate\n"
        "assert not jax.config.values['jax_disable_most_optimizations']\n"
        f"everystate.train({BODY!r}, preset='test', progress=False, run_dir=sys.argv[1])"
    )

    def run(folder: Path) -> None:
        subprocess.run([sys.executable, "-c", script, str(folder)], check=True, env=as_users)

    run(straight)
    shutil.copytree(straight, resumed)
    shutil.rmtree(resumed / "checkpoints" / "000003")
    run(resumed)
    assert [line["epoch"] for line in read_metrics(resumed)] == [1, 2, 3]
    assert timeless(resumed) == timeless(straight)
    one, other = (
        safetensors.numpy.load_file(folder / "checkpoints/000003/state.safetensors")
        for folder in (straight, resumed)
    )
    assert one.keys() == other.keys()
    assert [n for n in one if one[n].tobytes() != other[n].tobytes()] == []


def test_a_run_says_what_it_did(trained: tuple[Path, list[int]]) -> None:
    run, _ = trained
    config = preset("test", BODY)
    metrics = read_metrics(run)
    assert [line["epoch"] for line in metrics] == [1, 2, 3, 4]
    per_epoch, warmup = config.steps_per_epoch, config.warmup_steps
    assert [line["steps"] for line in metrics] == [
        config.num_bodies * (warmup + n * per_epoch) for n in (1, 2, 3, 4)
    ]
    cells = [line["coverage/cells"] for line in metrics]
    assert cells == sorted(cells)
    assert 0 < cells[0] < cells[-1] < 1
    assert {"loss/f", "env/falls_per_1000", "episode/reached", "time/updates_per_s"} <= {
        *metrics[0]
    }
    with np.load(run / "samples" / "000004.npz") as samples:
        assert samples["next_observations"].shape == (per_epoch * config.num_bodies, 2)
        assert samples["goals"].shape == (config.num_bodies, 2)
        assert samples["visited"].mean() == cells[-1]
    assert list((run / "tensorboard").glob("events*"))
    told = json.loads((run / "config.json").read_text())
    assert told["config"]["body"] == BODY
    assert "jax" in told["versions"]


def test_a_run_holds_its_agent(trained: tuple[Path, list[int]]) -> None:
    run, _ = trained
    agent = everystate.load(run)
    assert agent.body.state_names == ("x", "y")
    assert (np.abs(agent.act([0.0, 0.0], agent.propose_goals(5))) <= 1).all()


# --- The schedule ---


@pytest.mark.usefixtures("no_learning")
def test_a_finished_run_is_left_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    run = quietly(run_dir=tmp_path / "run")
    before = timeless(run), checkpoints(run)
    assert train(BODY, preset="test", run_dir=run) == run
    shown = capsys.readouterr().out
    assert "is finished" in shown
    assert "compil" not in shown
    assert (timeless(run), checkpoints(run)) == before


@pytest.mark.slow
def test_a_run_goes_on_for_more_epochs_as_if_it_had_always_been_meant_to(tmp_path: Path) -> None:
    """The step size falls without knowing when the run will end."""
    open_ended: dict[str, Any] = {"rate_halving": 1.0, "averaged": 0.5}
    straight = quietly(run_dir=tmp_path / "straight", epochs=3, **open_ended)
    longer = quietly(run_dir=tmp_path / "longer", epochs=2, **open_ended)
    assert quietly(run_dir=longer, epochs=3, **open_ended) == longer
    assert timeless(longer) == timeless(straight)
    assert json.loads((longer / "config.json").read_text())["config"]["epochs"] == 3
    with pytest.raises(EverystateError, match="epochs 3 there and 2 here"):
        quietly(run_dir=longer, epochs=2, **open_ended)
    with pytest.raises(EverystateError, match="width"):
        quietly(run_dir=longer, epochs=4, width=8, **open_ended)


@pytest.mark.usefixtures("no_learning")
def test_folder_and_config_follow_the_arguments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert quietly(seed=7, epochs=1) == Path("runs/ramp-pointmass-test-seed7")
    config = preset("test", seed=7, epochs=1)
    again = train(config, progress=False, epochs=2)
    assert again == Path("runs/ramp-pointmass-custom-seed7")
    assert len(read_metrics(again)) == 2


@pytest.mark.parametrize("during", ["collection", "update"])
def test_ctrl_c_saves_the_last_whole_epoch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, during: str
) -> None:
    per_epoch = preset("test").steps_per_epoch
    at = per_epoch + 3 if during == "collection" else 2 * per_epoch - 1

    def press(step: int) -> None:
        if step == at:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(loop, "compiled", lambda config: idle(press))
    handler = signal.getsignal(signal.SIGINT)
    run = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(BODY, preset="test", run_dir=run, progress="plain", epochs=4, checkpoint_period=4)
    assert signal.getsignal(signal.SIGINT) is handler
    done = 1 if during == "collection" else 2
    assert checkpoints(run) == [f"{done:06d}"]
    assert len(read_metrics(run)) == done
    shown = capsys.readouterr().out
    assert f"{done:06d} holds the run after epoch {done}" in shown
    said = [
        "training in",
        "compiling: about a minute the",
        "compiled, and epoch 1 done, in",
        "epoch 1/4",
    ]
    places = [shown.index(text) for text in said]
    assert places == sorted(places)

    monkeypatch.setattr(loop, "compiled", lambda config: idle())
    train(BODY, preset="test", run_dir=run, progress="plain", epochs=4, checkpoint_period=4)
    shown = capsys.readouterr().out  # a program is compiled in every process
    assert shown.count("compiled, and epoch") == shown.count(f"and epoch {done + 1} done") == 1
    straight = quietly(run_dir=tmp_path / "straight", epochs=4, checkpoint_period=4)
    assert timeless(run) == timeless(straight)


@pytest.mark.usefixtures("no_learning")
@pytest.mark.parametrize("answer", [False, np.False_])
def test_a_callback_that_says_false_stops_the_run_which_goes_on_later(
    tmp_path: Path, capsys: pytest.CaptureFixture, answer: Any
) -> None:
    asked: dict[str, Any] = {"epochs": 4, "checkpoint_period": 3}
    run, seen = tmp_path / "run", []

    def stop(metrics: Mapping[str, int | float]) -> bool | None:
        seen.append(metrics["epoch"])
        return answer if metrics["epoch"] == 2 else None

    train(BODY, preset="test", run_dir=run, progress="plain", on_epoch=stop, **asked)
    assert seen == [1, 2]
    assert checkpoints(run) == ["000002"]
    assert "stopped by on_epoch" in capsys.readouterr().out
    quietly(run_dir=run, on_epoch=lambda metrics: True, **asked)
    straight = quietly(run_dir=tmp_path / "straight", **asked)
    assert timeless(run) == timeless(straight)


FACTORY = """
import gymnasium, numpy as np

class Still(gymnasium.Env):
    observation_space = action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def reset(self, *, seed=None, options=None):
        return np.zeros(2, np.float32), {}

    def step(self, action):
        return np.zeros(2, np.float32), 0.0, False, False, {}

def make_env(limit=3):
    return gymnasium.wrappers.TimeLimit(Still(), limit)
"""


@pytest.mark.usefixtures("no_learning")
def test_a_run_on_what_makes_environments_is_one_on_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    Path("my_envs.py").write_text(FACTORY)
    my_envs = importlib.import_module("my_envs")
    run = train(my_envs.make_env, preset="test", epochs=1, progress=False)
    assert run == Path("runs/my_envs-make_env-test-seed0")
    assert everystate.load(run).config.body == "my_envs:make_env"
    assert train("my_envs:make_env", preset="test", epochs=2, progress=False) == run
    assert len(read_metrics(run)) == 2
    assert train(envs.RampPointmass, preset="test", epochs=1, progress=False).name == (
        "ramp-pointmass-test-seed0"
    )
    with pytest.raises(EverystateError, match=r"lambda.*a module of its own"):
        train(lambda: my_envs.make_env(), preset="test")
    del sys.modules["my_envs"]


def test_metrics_that_are_not_finite_stop_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "compiled", lambda config: idle(loss=float("nan")))
    with pytest.raises(EverystateError, match="in epoch 1: loss/f is nan"):
        quietly(run_dir=tmp_path / "run", epochs=3)
    assert read_metrics(tmp_path / "run") == []


# --- Parts ---


def test_a_bar_is_drawn_only_on_a_terminal() -> None:
    assert [shown(x) for x in (True, "plain", False)] == ["plain", "plain", "nothing"]


def test_an_environment_resumes_where_it_stopped() -> None:
    """What the loop relies on: observations and the environment's state say all."""
    first, second = (envs.make(BODY, 4, seed) for seed in (0, 1))
    action = np.full((4, 2), 0.5)
    first.step(action)
    second.set_state(first.get_state())
    np.testing.assert_array_equal(first.step(action)[0], second.step(action)[0])


def test_what_watches_a_run_does_not_change_it(
    trained: tuple[Path, list[int]], tmp_path: Path
) -> None:
    """Evaluations, more checkpoints and another way of telling leave every number as it is."""
    straight, _ = trained
    watched = tmp_path / "watched"
    train(
        BODY,
        preset="test",
        run_dir=watched,
        progress="plain",
        epochs=4,
        checkpoint_period=1,
        evaluation_period=2,
    )
    without = [
        {name: x for name, x in line.items() if not name.startswith("eval/")}
        for line in timeless(watched)
    ]
    assert without == timeless(straight)
    assert any(name.startswith("eval/") for name in read_metrics(watched)[1])
