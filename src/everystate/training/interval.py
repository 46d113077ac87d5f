"""How many control steps a run learns over at a time: as many as the body's pace asks for [D47]."""

import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from everystate.agent.json_files import read_json
from everystate.config import Config
from everystate.evaluation.playing import go, player
from everystate.training.bodies import make_bodies

SLOW, QUICK = 1 / 12, 1 / 2
"""Shares of a component's spread. Within an interval each has to change by the one if it can, and
none may change by more than the other."""
_BODIES, _STEPS, _LONGEST = 20, 400, 20


def with_interval(config: Config, run: Path) -> Config:
    """The config of a run with its `interval`: that which the run has, or measured on the body.

    Raises:
        EverystateError: there is no such body.
    """
    if config.interval:
        return config
    return replace(config, interval=_begun(run) or _measured(config))


def _begun(run: Path) -> int | None:
    """Of the run in this folder; None where there is none that can be read, which others tell."""
    try:
        return int(read_json(run / "config.json")["config"]["interval"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _measured(config: Config) -> int:
    env = make_bodies(config, _BODIES)
    rng = np.random.default_rng([config.seed, zlib.crc32(b"interval")])
    states, ended = go(env, _STEPS, player(env, rng), seed=config.seed)
    env.close()
    return fitting(states, ended)


def fitting(
    states: Float[np.ndarray, "_ bodies s"], ended: Bool[np.ndarray, "steps bodies"]
) -> int:
    """The least number of steps in which every component changes by `SLOW` of its spread.

    Or the largest in which none changes by more than `QUICK`, if that is less. A change is a root
    mean square over steps; components that do not change at all say nothing.

    Args:
        states: [steps + 1, bodies, s], any units.
        ended: where a body was put elsewhere after a step.
    """
    spread = states.std(axis=(0, 1))
    moves = np.ptp(states, axis=0).max(axis=0) > 1e-6
    lives = np.concatenate([np.zeros_like(ended[:1], int), np.cumsum(ended, axis=0)])
    for steps in range(1, _LONGEST + 1):
        change = (states[steps:] - states[:-steps])[..., moves] / spread[moves]
        whole = lives[steps:] == lives[:-steps]
        changes = np.sqrt(np.mean(change[whole] ** 2, axis=0))
        if not (changes.size and changes.max() <= QUICK):  # of what is not a number neither
            return max(1, steps - 1)
        if changes.min() >= SLOW:
            return steps
    return _LONGEST
