"""The training loop: a schedule of collection, learning, logging and checkpoints."""

import time
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import equinox as eqx
import jax
import numpy as np

from everystate import evaluation
from everystate.agent import Agent, keep_compiled_programs
from everystate.agent.files import BODY
from everystate.config import Config
from everystate.envs import BodyVectorEnv, body_of
from everystate.errors import EverystateError
from everystate.learning.completion import visited
from everystate.presets import preset as preset_of
from everystate.training import checkpoint, coverage, faults, hosts
from everystate.training.assist import assist
from everystate.training.bodies import info, make_bodies, with_own_copy
from everystate.training.checkpoint import Snapshot
from everystate.training.collection import (
    bounds,
    collect,
    save_samples,
    to_device,
    warm_up,
    world_metrics,
)
from everystate.training.groups import Crew, Groups, InProcess, size_of
from everystate.training.interval import with_interval
from everystate.training.learner import Learner, compiled
from everystate.training.logging import Log, OnEpoch, shown
from everystate.training.rundir import default_run_dir, open_run, preset_name
from everystate.training.stops import interrupts, written

_visited = eqx.filter_jit(visited)

COMPILING = "compiling: about a minute the first time, seconds after that"


def train(
    config_or_body: Config | str | Callable[..., Any],
    *,
    preset: str = "quick",
    run_dir: str | Path | None = None,
    progress: bool | Literal["plain"] = True,
    on_epoch: OnEpoch | None = None,
    crew: Crew | None = None,
    **overrides: Any,
) -> Path:
    """Trains an agent, or goes on with a run that was interrupted, and returns the run's folder.

    The same call resumes from the last checkpoint and ends in the same agent, bit for bit, as if
    there had been no interruption. A finished run is left as it is. Ctrl-C saves the run as it was
    after its last whole epoch and raises KeyboardInterrupt; a second one gives up at once.

    Where `jax.distributed` has made this process one of several, all of them call this alike: the
    first trains and has the folder, the others lend their devices until it is done.

    Args:
        config_or_body: a `Config`; or a body to be learned under `preset`: its name, or a `Body`
            class or what makes a Gymnasium environment, of which the run keeps module and name.
        preset: see `everystate.preset`; unused with a `Config`.
        run_dir: the run's folder, by default `runs/BODY-PRESET-seedSEED`.
        progress: a bar on a terminal and plain lines elsewhere; "plain" lines; or False, nothing.
        on_epoch: is called after each epoch with its metrics, those of metrics.jsonl. Where it
            returns False, the run is saved and left; the same call goes on with it.
        crew: where the collectors of `collectors=N` are: by default in this process, one after the
            other; or on a cluster, by `everystate.scaling.on_ray`. It does not change the result.
        **overrides: fields of the config to change.

    Raises:
        EverystateError: a wrong name or value, a run folder that is foreign, of another config or
            body or in use, fewer devices than told, a run that stopped being finite, or another
            host that was lost. Nothing is lost or overwritten.
    """
    if isinstance(config_or_body, Config):
        config = preset_of("quick", **(asdict(config_or_body) | overrides))
        preset = preset_name(config)
    else:
        named = isinstance(config_or_body, str)
        body = config_or_body if named else body_of(config_or_body)
        config = preset_of(preset, body, **overrides)
    keep_compiled_programs()
    hosts.check(config)
    path = Path(run_dir or default_run_dir(config, preset))
    log = partial(Log, epochs=config.epochs, show=shown(progress), on_epoch=on_epoch)
    if hosts.leads():
        with hosts.leading():
            stopped = _lead(config, path, crew, log)
        if stopped:
            raise KeyboardInterrupt
    else:
        assist(config)
    return path


def _lead(config: Config, path: Path, crew: Crew | None, make_log: Callable[..., Log]) -> bool:
    """Trains, and returns whether Ctrl-C was pressed."""
    # With a crew, only to know what they are like: theirs may be robots.
    count = 1 if crew else size_of(config)
    config = with_interval(config, path)
    env = _bodies(config, count, path)
    with written(), open_run(path, config, info(config, env)) as folder:
        own = with_own_copy(config, env, folder)
        if own != config:
            config, env = own, make_bodies(own, count)
        space = info(config, env).space
        snapshot = checkpoint.restore(folder / "checkpoints", config, space)
        done = snapshot.epoch if snapshot else 0
        with (
            interrupts() as interrupted,
            make_log(folder, done=done) as log,
        ):
            learner = compiled(config)
            crew = crew or InProcess(learner, env, interrupted)
            groups = Groups(config, crew, interrupted)
            _run(config, env, learner, groups, folder, snapshot, log, interrupted)
            return interrupted()


def _bodies(config: Config, count: int, run: Path) -> BodyVectorEnv:
    """The bodies as they are outside of the run's folder."""
    try:
        return make_bodies(config, count)
    except EverystateError as error:
        if (run / BODY).exists():
            raise EverystateError(
                f"{error}; {run / BODY} has the file that the run in {run} learned on"
            ) from error
        raise


def _run(
    config: Config,
    env: BodyVectorEnv,
    learner: Learner,
    groups: Groups,
    folder: Path,
    snapshot: Snapshot | None,
    log: Log,
    interrupted: Callable[[], bool],
) -> None:
    start = time.perf_counter() - log.elapsed_before
    if snapshot is None:
        log.say(f"training in {folder}")
        if config.interval > 1:
            log.say(f"learning over {config.interval} control steps at a time, as the body is slow")
        log.say(COMPILING)
        snapshot = warm_up(config, env, groups)
        if snapshot is None:
            return
    elif snapshot.epoch == config.epochs:
        return log.say(f"{folder} is finished: nothing to do")
    else:
        log.say(f"resuming {folder} after epoch {snapshot.epoch}")
        if not env.exact_restore:
            log.say(f"{env.name} cannot be put back into a state: its bodies start anew")
        log.say(COMPILING)
    hosts.go_on()
    snapshot = snapshot._replace(agent=hosts.shared(config, snapshot.agent))

    first = snapshot.epoch + 1
    while snapshot.epoch < config.epochs:
        epoch, before = snapshot.epoch + 1, time.perf_counter()
        done = collect(learner, groups, snapshot)
        if done is None:
            saved = _save(config, env, folder, snapshot)
            return log.say(f"stopped; {saved} holds the run after epoch {epoch - 1}")
        agent, collected = done
        steps = collected.steps
        hosts.go_on()
        agent = learner.observe(agent, to_device(steps))
        jax.block_until_ready(agent.replay.size)

        between = time.perf_counter()
        agent, learned, fault = learner.update(agent)
        metrics = {name: float(value) for name, value in jax.device_get(learned).items()}
        after = time.perf_counter()
        if epoch == first:
            log.say(
                f"compiled, and epoch {first} done, in {after - start - log.elapsed_before:.0f} s"
            )
        met = _agent(config, env, snapshot._replace(agent=agent))
        if problem := faults.report(folder, epoch, metrics, fault, met):
            if config.not_finite == "stop" or faults.not_finite(metrics):
                further = {
                    "stop": ", or --not-finite roll-back to go on without such updates",
                    "roll-back": ": no update of this epoch was finite",
                }
                raise EverystateError(
                    f"training stopped {problem}. {_kept(folder / 'checkpoints')}; try a lower"
                    f" learning_rate or gradient_clip{further[config.not_finite]}"
                )
            log.say(f"left out {problem}")

        visited = coverage.visit(snapshot.visited, steps.next_observations, *bounds(env))
        snapshot = Snapshot(agent, collected.env, collected.observations, visited)
        metrics |= world_metrics(config, env, steps, snapshot)
        if config.evaluation_period and epoch % config.evaluation_period == 0:
            metrics |= evaluation.logged(_agent(config, env, snapshot))
        metrics |= {
            "time/collect_s": between - before,
            "time/update_s": after - between,
            "time/updates_per_s": config.num_updates / (after - between),
            "time/elapsed_s": after - start,
        }
        go_on = log.epoch({"epoch": epoch, **metrics})
        if epoch % config.checkpoint_period == 0 or epoch == config.epochs:
            save_samples(folder / "samples", steps, snapshot)
            _save(config, env, folder, snapshot)
        elif not go_on:
            _save(config, env, folder, snapshot)
        if not go_on and epoch < config.epochs:
            return log.say(f"stopped by on_epoch; {folder} holds the run after epoch {epoch}")
    log.say(f"finished: {folder}")


def _save(config: Config, env: BodyVectorEnv, folder: Path, snapshot: Snapshot) -> Path:
    snapshot = snapshot._replace(agent=hosts.local(snapshot.agent))
    seen = np.asarray(_visited(config, snapshot.agent))
    agent = replace(_agent(config, env, snapshot), visited=seen)
    return checkpoint.save(folder / "checkpoints", snapshot, agent, config.checkpoint_period)


def _kept(checkpoints: Path) -> str:
    if any(checkpoints.glob("[0-9]*")):
        return f"The last good checkpoint is kept in {checkpoints}"
    return "There was no checkpoint yet (a smaller checkpoint_period makes them sooner)"


def _agent(config: Config, env: BodyVectorEnv, snapshot: Snapshot) -> Agent:
    models, scale = hosts.local((snapshot.agent.kept, snapshot.agent.scale))
    return Agent(models, scale, config, info(config, env))
