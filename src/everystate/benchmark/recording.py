"""The ways of anybody's agent to the goals of a suite, in a file.

It is a safetensors file with one array, `states`, float32 [tasks, steps + 1, state]: what the body
of each task observed, its start first, up to the longest horizon of the suite. What lies beyond a
task's own horizon is not looked at, and NaN where `save` wrote it. Its metadata are texts: `body`,
`suite`, `split` and the suite's `checksum`.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
import safetensors
import safetensors.numpy
from jaxtyping import Float, Float32

from everystate.benchmark.environments import ENVIRONMENTS
from everystate.benchmark.vector_env import GoalVectorEnv, Observation
from everystate.envs import make
from everystate.errors import EverystateError, suggest
from everystate.evaluation import metrics, suite_file, suites
from everystate.evaluation.suite import Suite
from everystate.evaluation.suites import Split

Act = Callable[[Observation], Any]
_ABOUT = ("body", "suite", "split", "checksum")
_ASIDE = 0.01
"""How far from a task's start its first state may lie, in units of sigma."""


def record(
    act: Act,
    env: str,
    path: Path | str,
    *,
    split: Split = "report",
    suite: str | Path | None = None,
    seed: int = 0,
) -> Path:
    """Sends an agent to every goal of a suite, all at once, and writes how it went to a file.

    Args:
        act: from the observations of all bodies, each `[tasks, state]` as `GoalVectorEnv` has them,
            to their actions, `[tasks, action]` in [-1, 1]. It is called once for each step, in
            order.
        env: id of the environment, one of `ENVIRONMENTS`.
        path: of the file, NAME.safetensors; one that is there is replaced.
        split: "report" to score; "tune" to choose settings by.
        suite: file of a suite of one's own for the same body.
        seed: of the body's noise.

    Returns:
        The path.

    Raises:
        EverystateError: there is no such environment, suite or split, or an action is none.
    """
    body, asked = _suite_of(env, suite)
    tasks = suites.load(body, asked, split=split)
    bodies = GoalVectorEnv(len(tasks.goals), body, asked, split)
    observations, _ = bodies.reset(seed=seed, options={"task": np.arange(bodies.num_envs)})
    states = [observations["observation"]]
    for _ in range(int(tasks.horizons.max())):
        observations = bodies.step(act(observations))[0]
        states.append(observations["observation"])
    bodies.close()
    return save(path, env, np.stack(states, axis=1), split=split, suite=suite)


def save(
    path: Path | str,
    env: str,
    states: Sequence[Float[np.ndarray, "_ state"]] | Float[np.ndarray, "tasks _ state"],
    *,
    split: Split = "report",
    suite: str | Path | None = None,
) -> Path:
    """Writes the file of ways that one went oneself, by a loop or a simulation of one's own.

    Args:
        path: of the file; one that is there is replaced.
        env: id of the environment, one of `ENVIRONMENTS`.
        states: what was observed on the way of each task, in the order of the suite: its start and
            at least as many states as its horizon has steps. Further ones are left out.
        split: whose tasks they are.
        suite: file of a suite of one's own.

    Returns:
        The path.

    Raises:
        EverystateError: there is no such environment, suite or split; or the states are too few, or
            no such ways.
    """
    body, asked = _suite_of(env, suite)
    tasks = suites.load(body, asked, split=split)
    if len(states) != len(tasks.goals):
        raise EverystateError(
            f"states has the ways of {len(states)} tasks: give one for each of the"
            f" {len(tasks.goals)} of {env} ({split})"
        )
    size, longest = tasks.goals.shape[1], int(tasks.horizons.max())
    kept = np.full((len(states), longest + 1, size), np.nan, dtype=np.float32)
    for task, (way, horizon) in enumerate(zip(states, tasks.horizons, strict=True)):
        way = np.asarray(way)
        if way.ndim != 2 or way.shape[1] != size or len(way) <= horizon:
            raise EverystateError(
                f"states of task {task} have shape {way.shape}: expected its start and the states"
                f" after {horizon} steps, ({horizon + 1}, {size})"
            )
        kept[task, : horizon + 1] = way[: horizon + 1]
    _check(tasks, kept, "states")
    told = (body, tasks.name, split, suite_file.checksum(suite_file.as_json(tasks)))
    safetensors.numpy.save_file({"states": kept}, path, dict(zip(_ABOUT, told, strict=True)))
    return Path(path)


def read(
    path: Path | str, suite: str | Path | None = None
) -> tuple[Suite, Float32[np.ndarray, "steps tasks state"]]:
    """The suite and the states of a file, a row per step; beyond a task's horizon its last state.

    Args:
        path: of the file.
        suite: file of the suite, if it is of one's own.

    Raises:
        EverystateError: the file is missing, damaged or none; or of another suite; or its states
            are not of the suite's shape, not finite, or do not begin at the starts.
    """
    about, states = _open(Path(path))
    body, name, split = about["body"], about["suite"], about["split"]
    # What a file says is looked up, never imported or opened.
    known = (body, name) in ENVIRONMENTS.values() and split in get_args(Split)
    if not known and (suite is None or body not in dict(ENVIRONMENTS.values())):
        raise EverystateError(
            f"{path} was recorded on {name!r} ({split}) of {body!r}, which is no suite of the"
            " benchmark: name the file of your own by --suite"
        )
    tasks = suites.load(body, suite or name, split=split)  # pyright: ignore[reportArgumentType]
    checksum = suite_file.checksum(suite_file.as_json(tasks))
    if about["checksum"] != checksum:
        raise EverystateError(
            f"{path} was recorded on another {name!r} of {body}: its checksum is"
            f" {about['checksum'][:12]}, not {checksum[:12]}; record it again, or name the file of"
            " your own suite by --suite"
        )
    shape = (len(tasks.goals), int(tasks.horizons.max()) + 1, tasks.goals.shape[1])
    if states.dtype != np.float32 or states.shape != shape:
        raise EverystateError(
            f"states of {path} are {states.dtype} {states.shape}: expected float32 {shape}"
        )
    _check(tasks, states, f"states of {path}")
    step = np.minimum(np.arange(shape[1])[:, None], tasks.horizons)
    return tasks, states[np.arange(shape[0]), step]


def _open(path: Path) -> tuple[dict[str, str], np.ndarray]:
    """Metadata and states, whatever they are."""
    if not path.is_file():
        raise EverystateError(f"there is no recording {path}: give the path of one")
    try:
        with safetensors.safe_open(path, "numpy") as file:
            about = file.metadata() or {}
            return {name: about[name] for name in _ABOUT}, file.get_tensor("states")
    except (OSError, KeyError, ValueError, TypeError, safetensors.SafetensorError) as error:
        problem = " ".join(f"{type(error).__name__}: {error}".split())
        raise EverystateError(
            f"{path} is no recording ({problem}): write it by everystate.benchmark.record or save"
        ) from error


def _check(suite: Suite, states: Float32[np.ndarray, "tasks steps state"], what: str) -> None:
    """They are finite up to the horizons, and begin where the suite says."""
    within = np.arange(states.shape[1]) <= suite.horizons[:, None]
    if wrong := np.argwhere(within & ~np.isfinite(states).all(axis=2)).tolist():
        task, step = wrong[0]
        raise EverystateError(f"{what} are not finite in task {task} after {step} steps")
    bodies = make(suite.body, len(suite.goals), 0)
    begun, first = (bodies.scored(x) for x in (suite.begin(bodies, 0), states[:, 0]))
    angular = suite.mask(suite.angular)
    apart = metrics.differences(first[None], begun, suite.sigma, angular)[0].max(axis=1)
    if suite.starts is not None and (apart > _ASIDE).any():
        task = int(np.argmax(apart > _ASIDE))
        raise EverystateError(
            f"{what} begin {apart[task]:.2f} sigma from the start of task {task}: the start comes"
            " first, and tasks are in the order of the suite"
        )


def _suite_of(env: str, suite: str | Path | None) -> tuple[str, str | Path]:
    """Body and suite of an environment, or one's own suite in its place."""
    if env not in ENVIRONMENTS:
        raise EverystateError(f"no environment {env!r}: {suggest(env, ENVIRONMENTS)}")
    body, shipped = ENVIRONMENTS[env]
    return body, suite or shipped
