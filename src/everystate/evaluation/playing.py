"""Bodies that play: the paths that suites are cut from, and the distances they are told by."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from everystate import envs
from everystate.envs import BodyVectorEnv, Physics
from everystate.errors import EverystateError
from everystate.evaluation import metrics

BODIES, STEPS = 30, 400
"""How many play, and for how many steps."""
_REFERENCE = 2
"""Seed of the paths that sigma is measured on."""

Act = Callable[[int], Float[np.ndarray, "envs action"]]
"""What all bodies do in a step, by its number."""


class World(NamedTuple):
    """A body, and what every suite of it has in common."""

    env: BodyVectorEnv
    sigma: Float[np.ndarray, " state"]
    constant: Bool[np.ndarray, " state"]
    """What never changes while a body moves, though it may differ from copy to copy."""


class Play:
    """Random actions that keep to themselves for a while: each component a slow wave of noise."""

    def __init__(self, rng: np.random.Generator, shape: tuple[int, ...]) -> None:
        self.rng = rng
        self.memory = rng.uniform(0.3, 0.95, (shape[0], 1))
        self.now = rng.normal(0, 1, shape)

    def __call__(self) -> Float[np.ndarray, "envs action"]:
        fresh = self.rng.normal(0, 1, self.now.shape)
        self.now = self.memory * self.now + np.sqrt(1 - self.memory**2) * fresh
        return self.now


@functools.lru_cache(maxsize=2)
def world_of(body: str, options: tuple[str, ...]) -> World:
    """The bodies, and the spread of their components while they play.

    Raises:
        EverystateError: success of the body is told by other components than its state's.
    """
    env = envs.make(body, BODIES, 0, **envs.parse_options(options))
    play = player(env, np.random.default_rng(_REFERENCE))
    states, _ = go(env, STEPS, play, seed=_REFERENCE)
    scored = env.scored(states)
    if scored.shape != states.shape:
        raise EverystateError(f"{body} needs a goal suite of its own: give a file of goals")
    spread = scored.std(axis=(0, 1))
    constant = states.std(axis=0).max(axis=0) <= 1e-6
    return World(env, np.where(constant | (spread <= 1e-6), 1.0, spread), constant)


def player(env: BodyVectorEnv, rng: np.random.Generator) -> Act:
    """Play that often takes actions to their ends."""
    play = Play(rng, env.action_space.shape)
    return lambda _: np.clip(2 * play(), -1, 1)


def go(
    env: BodyVectorEnv, steps: int, act: Act, *, seed: int | None = None
) -> tuple[Float[np.ndarray, "_ envs state"], Bool[np.ndarray, "{steps} envs"]]:
    """States [steps + 1] from a reset with this seed, or from here; and where one was restarted."""
    states = [env.observe() if seed is None else env.reset(seed=seed)[0]]
    ended = []
    for step in range(steps):
        now, _, over, _, _ = env.step(act(step))
        states.append(now)
        ended.append(over)
    return np.stack(states).astype(np.float64), np.stack(ended)


def go_from(
    env: BodyVectorEnv, starts: list[Physics], steps: int, act: Act
) -> Float[np.ndarray, "_ n state"]:
    """States [steps + 1] of the first bodies, put to these starts; `act` has as many actions."""
    num, actions = len(starts), np.zeros(env.action_space.shape)
    env.set_physics(starts, np.arange(env.num_envs) < num)

    def padded(step: int) -> Float[np.ndarray, "envs action"]:
        actions[:num] = act(step)
        return actions

    return go(env, steps, padded)[0][:, :num]


def apart(
    world: World, states: Float[np.ndarray, "*steps n state"], goals: Float[np.ndarray, "n state"]
) -> Float[np.ndarray, "*steps n"]:
    """The largest difference among the components, in units of sigma."""
    return _by(metrics.largest, world, states, goals)


def apart_in_motion(
    world: World, states: Float[np.ndarray, "*steps n state"], goals: Float[np.ndarray, "n state"]
) -> Float[np.ndarray, "*steps n"]:
    """The distance that a motion is told by, in units of sigma."""
    named = {"max": metrics.largest, "rms": metrics.rms}
    return _by(named[metrics.chief(len(world.sigma))], world, states, goals)


def _by(
    measure: Callable[..., np.ndarray], world: World, states: np.ndarray, goals: np.ndarray
) -> np.ndarray:
    steps = states.reshape(-1, *goals.shape)
    scored, wanted = world.env.scored(steps), world.env.scored(goals)
    found = measure(metrics.differences(scored, wanted, world.sigma), np.ones(goals.shape))
    return found.reshape(states.shape[:-1])


def spread_out(points: Float[np.ndarray, "n dims"], count: int) -> Int[np.ndarray, " count"]:
    """Indices of points far from one another: each the farthest from all before it."""
    chosen = [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmin())]
    nearest = np.full(len(points), np.inf)
    for _ in range(min(count, len(points)) - 1):
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(nearest.argmax()))
    return np.array(chosen)
