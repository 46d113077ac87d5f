"""Goal suites for any body that has none of its own: `rest` and `motion`, made on the spot.

What is asked is what the body can do: goals in motion lie on paths that it went, goals at rest are
states in which it came to rest under an action that did not change. What random actions never lead
to, a handstand, is not asked. The same seed makes the same suite; nothing is learned from it.
"""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from everystate.envs import BodyVectorEnv, Physics
from everystate.errors import EverystateError
from everystate.evaluation.playing import (
    BODIES,
    STEPS,
    World,
    apart,
    apart_in_motion,
    go,
    go_from,
    player,
    spread_out,
    world_of,
)
from everystate.evaluation.suite import Split, Suite

KS = (4, 8, 16, 32, 64)
"""Steps on the path from the start of a goal in motion to the goal."""
_PER_K, _FEWEST = 20, 20  # tasks for each k; a suite of fewer in all is none
_TIMES, _CHUNKS = 20, 3  # when starts are read; at most so many times as many candidates as bodies
_TRIES, _EASY = 10, 0.5  # of random actions, none of which may come so near, in sigma
_ROUNDS, _PLAY, _HELD, _STILL = 6, 100, 300, 25  # plays, then one action held, the last steps still
_STRENGTHS = (0.0, 0.3, 1.0)
_AT_REST, _GOALS, _HORIZON = 0.1, 100, 200
_SEEDS: dict[Split, int] = {"report": 0, "tune": 1}


class _Tasks(NamedTuple):
    """Where bodies begin, and where they are to go."""

    starts: list[Physics]
    begun: Float[np.ndarray, "n state"]
    goals: Float[np.ndarray, "n state"]
    k: Int[np.ndarray, " n"]
    horizons: Int[np.ndarray, " n"]
    actions: Sequence[Float[np.ndarray, "k action"]] = ()

    def only(self, chosen: Int[np.ndarray, " m"]) -> "_Tasks":
        starts = [self.starts[i] for i in chosen]
        actions = [self.actions[i] for i in chosen] if self.actions else []
        begun, goals, k, horizons = (x[chosen] for x in self[1:5])
        return _Tasks(starts, begun, goals, k, horizons, actions)


def names(body: str, options: tuple[str, ...] = (), split: Split = "report") -> tuple[str, ...]:
    """Those of the suites that can be made, `rest` first.

    Raises:
        EverystateError: none can; see `suite`.
    """
    found = tuple(name for name in MAKERS if _made(body, options, split, name))
    return found or (suite(body, options, split).name,)


def suite(
    body: str, options: tuple[str, ...] = (), split: Split = "report", name: str | None = None
) -> Suite:
    """One of them, by default the first that can be made.

    Raises:
        EverystateError: it can't be, as the body never rests or never moves while it plays, or
            success of the body is told by other components than its state's.
    """
    for one in MAKERS if name is None else (name,):
        if found := _made(body, options, split, one):
            return found
    what = "comes to rest" if name == "rest" else "moves far"
    raise EverystateError(
        f"{body} has no suite {name or 'motion'!r}, as it never {what} while it plays: choose"
        f" another of {', '.join(MAKERS)}, or give a file of goals"
    )


@functools.lru_cache(maxsize=8)
def _made(body: str, options: tuple[str, ...], split: Split, name: str) -> Suite | None:
    """One of them; None where there are too few tasks for it."""
    world = world_of(body, options)
    tasks = MAKERS[name](world, np.random.default_rng([_SEEDS[split], len(name)]))
    if len(tasks.starts) < _FEWEST:
        return None
    env = world.env

    def named(*, velocity: bool) -> tuple[str, ...]:
        of = zip(env.state_names, env.state_units, strict=True)
        return tuple(one for one, unit in of if unit.endswith("/s") == velocity)

    return Suite(
        body=body,
        name=name,
        split=split,
        notes=_NOTES[name],
        seed=_SEEDS[split],
        components=tuple(env.state_names),
        sigma=world.sigma,
        angular=(),
        position=named(velocity=False),
        velocity=named(velocity=True),
        starts=tuple(tasks.starts),
        goals=tasks.goals,
        weights=np.ones(tasks.goals.shape),
        kinds=tuple(env.regions(tasks.goals).tolist()),
        k=tasks.k,
        horizons=tasks.horizons,
        actions=tuple(tasks.actions) or None,
    )


def _motion(world: World, rng: np.random.Generator) -> _Tasks:
    """Pieces of paths of coloured noise, each played once more from where it begins."""
    env, read_at = world.env, rng.choice(STEPS, _TIMES, replace=False)
    play, taken, physics = player(env, rng), [], {}

    def act(step: int) -> Float[np.ndarray, "envs action"]:
        if step in read_at:  # reading the physics of a Gymnasium body takes longer than a step
            physics[step] = env.get_physics()
        taken.append(play(step))
        return taken[-1]

    states, ended = go(env, STEPS + max(KS), act, seed=int(rng.integers(2**31)))
    actions = np.stack(taken)
    hard, easy = [], []
    for k in KS:
        at = np.array([(t, i) for t in read_at for i in range(env.num_envs)])
        whole = np.array([not ended[t : t + k, i].any() for t, i in at])
        far = apart(world, states[at[:, 0], at[:, 1]], states[at[:, 0] + k, at[:, 1]]) > 1.0
        candidates = rng.permutation(at[whole & far])
        left = _PER_K
        for chunk in np.split(candidates, range(BODIES, len(candidates), BODIES))[:_CHUNKS]:
            if left <= 0 or not len(chunk):
                break
            starts = [physics[t][i] for t, i in chunk]
            pieces = np.stack([actions[t : t + k, i] for t, i in chunk])
            again = go_from(env, starts, k, lambda step, own=pieces: own[:, step])
            each = np.full(len(chunk), k)
            tasks = _Tasks(starts, again[0], again[-1], each, 2 * each + 10, tuple(pieces))
            far = apart(world, again[0], again[-1]) > 1.0
            fit = np.flatnonzero(far & ~_easy(world, tasks, rng))[:left]
            hard.append(tasks.only(fit))
            left -= len(fit)
            easy.append(tasks)
    found = _joined(hard, env)
    return found if len(found.starts) >= _FEWEST else _joined(easy, env)


def _easy(world: World, tasks: _Tasks, rng: np.random.Generator) -> Bool[np.ndarray, " n"]:
    """Which goals doing nothing passes, or one of some tries of random actions."""
    shape = (len(tasks.starts), world.env.action_space.shape[1])
    steps, hit = int(tasks.horizons[0]), np.zeros(len(tasks.starts), dtype=bool)
    for strength in (0.0, *[1.0] * _TRIES):
        states = go_from(
            world.env, tasks.starts, steps, lambda _, s=strength: s * rng.uniform(-1, 1, shape)
        )
        hit |= (apart_in_motion(world, states[1:], tasks.goals) <= _EASY).any(axis=0)
    return hit


def _rest(world: World, rng: np.random.Generator) -> _Tasks:
    """Where bodies came to rest under a constant action; starts are of others, half in motion."""
    env, rested, starts = world.env, [], []
    for _ in range(_ROUNDS):
        go(env, _PLAY, player(env, rng), seed=int(rng.integers(2**31)))
        moving = env.get_physics()
        strength = rng.choice(_STRENGTHS, (env.num_envs, 1))
        action = strength * rng.uniform(-1, 1, env.action_space.shape)
        states, ended = go(env, _HELD, lambda _, held=action: held)
        off = apart(world, states[-_STILL:], states[-1]).max(axis=0)
        rested += list(states[-1][(off <= _AT_REST) & ~ended.any(axis=0)])
        starts += moving[::2] + env.get_physics()[1::2]
    if len(rested) < _FEWEST:
        return _joined([], env)
    pool, kept = np.stack(rested), []
    goals = pool[spread_out(pool / world.sigma, _GOALS)]
    chosen = [starts[i] for i in rng.permutation(len(starts))[: len(goals)]]
    for at in range(0, len(goals), BODIES):
        some, wanted = chosen[at : at + BODIES], goals[at : at + BODIES]
        nothing = np.zeros((len(some), env.action_space.shape[1]))
        idle = go_from(env, some, _HORIZON, lambda _, still=nothing: still)
        # Nobody can change what its copy is made of.
        wanted = np.where(world.constant, idle[0], wanted)
        asked = (apart(world, idle[0], wanted) > 1.0) & (apart(world, idle[-1], wanted) > _EASY)
        zero, horizons = np.zeros(len(some), np.int64), np.full(len(some), _HORIZON)
        kept.append(_Tasks(some, idle[0], wanted, zero, horizons).only(np.flatnonzero(asked)))
    return _joined(kept, env)


def _joined(parts: list[_Tasks], env: BodyVectorEnv) -> _Tasks:
    none, nothing = np.zeros((0, len(env.state_names))), np.zeros(0, np.int64)
    parts = [_Tasks([], none, none, nothing, nothing), *parts]
    begun, goals = (np.concatenate(x) for x in ([p.begun for p in parts], [p.goals for p in parts]))
    k, horizons = (np.concatenate(x) for x in ([p.k for p in parts], [p.horizons for p in parts]))
    starts = [start for part in parts for start in part.starts]
    actions = [action for part in parts for action in part.actions]
    return _Tasks(starts, begun, goals, k, horizons, actions)


MAKERS: dict[str, Callable[[World, np.random.Generator], _Tasks]] = {
    "rest": _rest,
    "motion": _motion,
}
_NOTES = {
    "rest": "Made on the spot: states in which bodies came to rest under a constant action, after"
    " play. Every start is beyond 1 sigma of its goal, and doing nothing does not end there.",
    "motion": "Made on the spot: states on paths of coloured noise, k steps after the start, with"
    " horizons of 2 k + 10 steps. Every start is beyond 1 sigma of its goal, which neither doing"
    " nothing nor 10 tries of random actions come within 0.5 sigma of; where fewer than 20 would"
    " be left, these tasks are kept too.",
}
