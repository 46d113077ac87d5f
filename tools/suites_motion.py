"""Suites of states in motion, which a body can only pass: `motion`, told by a hit on the way.

Used by `make_suites.py`. Each task is cut from a path that the body went: it starts k steps before
the goal, and so the path's own actions lead there. From the start as it is written, rounded, they
are played once more; the goal is the state that this led to, so nothing is lost by rounding.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import ant_controllers as ants
import numpy as np
from cartpole_controllers import pump, regulator
from jaxtyping import Bool, Float, Int, Shaped
from suites_rest import SEEDS, ant_sigma, cartpole_sigma, rounded

from everystate.envs import BodyVectorEnv, Physics, make
from everystate.evaluation import metrics
from everystate.evaluation.playing import Play
from everystate.evaluation.suite import Suite
from everystate.evaluation.suites import Split
from everystate.skills.ant_rules import jumps, up

KS = (4, 8, 16, 32, 64)
"""Steps from start to goal."""
PER_K = 40
_BODIES, _STEPS = 100, 400
_CANDIDATES, _TRIED = 2000, 120  # cut from paths for each k, and tried; more of short ones
_RANDOM_TRIES, _MOST_HITS = 20, 1
_EASY = 0.5  # sigma, by the body's chief measure: what nothing and random actions must not reach

Controller = Callable[[Float[np.ndarray, "envs state"], int], Float[np.ndarray, "envs action"]]


class Moves(NamedTuple):
    """How a body is made to move for a suite, and what its motions are called."""

    play: Callable[[BodyVectorEnv, np.random.Generator], Controller]
    kinds: Callable[[Float[np.ndarray, "n state"]], Shaped[np.ndarray, " n"]]
    """What a state in motion is; "" for what is none."""
    sigma: Callable[[], Float[np.ndarray, " scored"]]
    positions: int
    """How many of the components, the first ones, are no velocities."""
    notes: str


class Cut(NamedTuple):
    """Pieces of paths, all of one k."""

    starts: list[Physics]
    actions: Float[np.ndarray, "n k action"]
    begun: Float[np.ndarray, "n state"]
    goals: Float[np.ndarray, "n state"]

    def only(self, chosen: Int[np.ndarray, " m"]) -> "Cut":
        return Cut([self.starts[i] for i in chosen], *(column[chosen] for column in self[1:]))


def motion(body: str, split: Split) -> Suite:
    """The suite of a body: for each k as many tasks, of every kind alike as far as there are."""
    moves, rng = MOVES[body], np.random.default_rng([SEEDS[split], 1])
    env = make(body, _BODIES, SEEDS[split])
    sigma = moves.sigma()
    physics, actions = _paths(env, moves.play(env, rng), rng)
    kept: list[Cut] = []
    for k in KS:
        more = max(1, 16 // k)  # most of what lies few steps apart is near, or easy
        cut = _cut(body, physics, actions, k, _CANDIDATES * more, rng)
        kinds = moves.kinds(cut.goals)
        far = metrics.differences(cut.begun[None], cut.goals, sigma)[0].max(axis=-1) > 1.0
        cut = cut.only(np.flatnonzero(far & (kinds != "")))
        cut = cut.only(_alike(moves.kinds(cut.goals), _TRIED * more, rng))
        cut = cut.only(np.flatnonzero(_hard(body, cut, sigma, k, rng)))
        kept.append(cut.only(_alike(moves.kinds(cut.goals), PER_K, rng)))
    return _suite(body, split, kept)


def paths_cut(
    body: str, split: Split, ks: Sequence[int], count: int, rng: np.random.Generator
) -> Suite:
    """So many tasks cut from paths for each k, whatever moves in them and however near they lie."""
    env = make(body, _BODIES, int(rng.integers(2**31)))
    physics, actions = _paths(env, MOVES[body].play(env, rng), rng)
    return _suite(body, split, [_cut(body, physics, actions, k, count, rng) for k in ks])


def _suite(body: str, split: Split, cuts: list[Cut]) -> Suite:
    moves, names = MOVES[body], make(body, 1, 0).state_names
    goals = np.concatenate([cut.goals for cut in cuts]).astype(float)
    ks = np.concatenate([np.full(len(cut.goals), cut.actions.shape[1]) for cut in cuts])
    return Suite(
        body=body,
        name="motion",
        split=split,
        notes=moves.notes,
        seed=SEEDS[split],
        components=tuple(names),
        sigma=moves.sigma(),
        angular=(),
        position=tuple(names[: moves.positions]),
        velocity=tuple(names[moves.positions :]),
        starts=tuple(start for cut in cuts for start in cut.starts),
        goals=goals.round(6),
        weights=np.ones_like(goals),
        kinds=tuple(moves.kinds(goals).tolist()),
        k=ks,
        horizons=2 * ks + 10,
        actions=tuple(actions for cut in cuts for actions in cut.actions),
    )


def _paths(
    env: BodyVectorEnv, act: Controller, rng: np.random.Generator
) -> tuple[list[list[Physics]], Float[np.ndarray, "steps envs action"]]:
    """Every body's physics before each step, and what it did; actions are of 3 decimals."""
    states, _ = env.reset(seed=int(rng.integers(2**31)))
    physics, taken = [], []
    for step in range(_STEPS):
        physics.append(env.get_physics())
        taken.append(np.clip(act(states.astype(float), step), -1, 1).round(3))
        states = env.step(taken[-1])[0]
    return physics, np.stack(taken)


def _cut(
    body: str,
    physics: list[list[Physics]],
    actions: Float[np.ndarray, "steps envs action"],
    k: int,
    count: int,
    rng: np.random.Generator,
) -> Cut:
    at, who = rng.integers(_STEPS - k, size=count), rng.integers(_BODIES, size=count)
    starts = list(rounded([physics[t][i] for t, i in zip(at, who, strict=True)]))
    pieces = np.stack([actions[t : t + k, i] for t, i in zip(at, who, strict=True)])
    env = make(body, len(starts), 0)
    env.set_physics(starts)
    begun = states = env.observe()
    for step in range(k):
        states = env.step(pieces[:, step])[0]
    return Cut(starts, pieces, begun, states)


def _hard(
    body: str, cut: Cut, sigma: np.ndarray, k: int, rng: np.random.Generator
) -> Bool[np.ndarray, " n"]:
    """Whether doing nothing misses the goal, and random actions hit it once in 20 tries at most."""
    env, num = make(body, len(cut.starts), 0), len(cut.starts)
    chief = {"max": metrics.largest, "rms": metrics.rms}[metrics.chief(len(sigma))]
    hits = np.zeros((_RANDOM_TRIES + 1, num), dtype=bool)
    for way in range(_RANDOM_TRIES + 1):
        env.set_physics(cut.starts)
        for _ in range(2 * k + 10):
            actions = rng.uniform(-1, 1, env.action_space.shape) * (way > 0)
            apart = metrics.differences(env.step(actions)[0][None], cut.goals, sigma)
            hits[way] |= chief(apart, np.ones_like(cut.goals))[0] <= _EASY
    return ~hits[0] & (hits[1:].sum(axis=0) <= _MOST_HITS)


def _alike(
    kinds: Shaped[np.ndarray, " n"], count: int, rng: np.random.Generator
) -> Int[np.ndarray, " m"]:
    """So many at random, of every kind as many as there are or as its share is."""
    at = rng.permutation(len(kinds))
    # The first of each kind come before the second of any.
    turn = np.array([(kinds[at[:i]] == kinds[at[i]]).sum() for i in range(len(at))], dtype=int)
    return np.sort(at[np.argsort(turn, kind="stable")[:count]])


# --- Cartpole ---


def cartpole_play(env: BodyVectorEnv, rng: np.random.Generator) -> Controller:
    """On the way up, upright and going along the rail, spinning, coming to rest, and at play."""
    up_there, down, num = regulator(0.0), regulator(np.pi), env.num_envs
    play = Play(rng, (num, 1))

    def act(states: np.ndarray, step: int) -> np.ndarray:
        nonlocal place, speed, what
        if step % 80 == 0:
            place, speed = rng.uniform(-1.3, 1.3, num), rng.uniform(2, 9, num)
            what = rng.integers(5, size=num)
        caught = (states[:, 1] > 0.9) & (np.abs(states[:, 4]) < 3.5)
        choices = [
            np.where(caught, up_there(states, place), pump(states, place, 0.0)),
            np.where(caught, up_there(states, place), pump(states, place, 0.0)),
            pump(states, place, speed),
            down(states, place),
            2 * play()[:, 0],
        ]
        return np.choose(what, choices)[:, None]

    place, speed, what = np.zeros(num), np.zeros(num), np.zeros(num, int)
    return act


def cartpole_kinds(states: Float[np.ndarray, "n 5"]) -> Shaped[np.ndarray, " n"]:
    """Passing the top, turning fast, swinging, or going along the rail with a quiet pole."""
    x, cosine, _, v, w = np.asarray(states, float).T
    kinds = np.where(np.abs(w) > 1, "swinging", np.where(np.abs(v) > 0.5, "going", ""))
    kinds = np.where((np.abs(w) > 6) & (cosine < 0.5), "turning", kinds)
    kinds = np.where((cosine > 0.7) & (np.abs(w) > 1), "passing the top", kinds)
    return np.where(np.abs(x) < 1.7, kinds, "")  # not while it runs into the end of the rail


# --- Ant ---


def ant_play(env: BodyVectorEnv, rng: np.random.Generator) -> Controller:
    """Random gaits, leaps, poses, and play; half of the ants begin upside down."""
    num = env.num_envs
    play, over = Play(rng, (num, 8)), rng.random(num) < 0.5

    def act(states: np.ndarray, step: int) -> np.ndarray:
        nonlocal what, gait, angles, leap
        if step == 0:
            states[over, 4:7] *= -1  # the y axis: half a turn about the x axis
            env.set_observations(states)
        if step % 60 == 0:
            what, gait, angles = (
                rng.integers(4, size=num),
                ants.Gait(rng, num),
                ants.poses(rng, num),
            )
            leap = rng.integers(10, 20, size=(num, 1))
        # A leap: all legs drawn in for a while, then pushed out at once.
        crouch = ants.CENTRE + ants.REACH * np.tile([0.0, 0.9], 4)
        spring = ants.CENTRE - ants.REACH * np.tile([0.0, 0.9], 4)
        legs = np.where(step % 30 < leap, crouch, spring) * np.sign(up(states))[:, None]
        choices = [
            gait(states, step),
            ants.towards(states, angles),
            3 * ants.towards(states, legs),
            2 * play(),
        ]
        return np.choose(what[:, None], choices)

    what, gait, angles, leap = np.zeros(num, int), ants.Gait(rng, num), ants.poses(rng, num), 10
    return act


def ant_kinds(states: Float[np.ndarray, "n 29"]) -> Shaped[np.ndarray, " n"]:
    """Jumping, rolling over, rising, turning, going, or moving its legs."""
    states = np.asarray(states, float)
    across, tilting = np.hypot(*states[:, 15:17].T), np.hypot(*states[:, 18:20].T)
    legs = np.abs(states[:, 21:]).max(axis=1) > 1.0
    kinds = np.where(legs, "moving its legs", "")
    kinds = np.where(across > 0.4, "going", kinds)
    kinds = np.where(np.abs(states[:, 20]) > 1.0, "turning", kinds)
    kinds = np.where(np.abs(states[:, 17]) > 0.5, "rising", kinds)
    kinds = np.where(tilting > 2.0, "rolling over", kinds)
    return np.where(jumps(states[None])[0], "jumping", kinds)


_NOTES = (
    " States in motion on recorded paths, for each k = 4, 8, 16, 32, 64 up to 40 of them, that a"
    " body which starts k steps before on the path can reach, by the path's own actions; the"
    " horizon is 2 k + 10 steps. Every start is beyond 1 sigma of its goal; left out is what doing"
    " nothing comes within 0.5 sigma of, by the measure of the score, or more than 1 of 20 tries of"
    " random actions. sigma is that of the suite `rest`."
)

MOVES = {
    "cartpole": Moves(
        cartpole_play,
        cartpole_kinds,
        cartpole_sigma,
        3,
        "Paths of controllers written by hand (swinging up and going along the rail upright,"
        " spinning, coming to rest) and of coloured noise." + _NOTES,
    ),
    "ant": Moves(
        ant_play,
        ant_kinds,
        ant_sigma,
        15,
        "Paths of random gaits, leaps, ways to poses, and coloured noise." + _NOTES,
    ),
}
