"""Suites of goals that ask for a part of a state: `parts`, and `parts-motion` of states in motion.

Used by `make_suites.py`. Tasks are made as those of `rest` and of `motion`; of each goal 1 to 5
components, drawn at random, count, and the others are free.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from suites_motion import KS, MOVES, paths_cut
from suites_rest import MAKERS, SEEDS

from everystate.envs import make
from everystate.evaluation import metrics
from everystate.evaluation.suite import Suite
from everystate.evaluation.suites import Split

_MOST = 5
"""Components asked at most."""
_TASKS = 200
_EASY = 0.5  # sigma, of what is asked, which doing nothing must not come within

_NOTES = (
    " Of each goal 1 to 5 components, but not all, drawn at random, are asked, as often each"
    " number; nothing else counts. Every start is beyond 1 sigma of what is asked, by the largest"
    " difference, and doing nothing never comes within 0.5 sigma of it. sigma is that of the suite"
    " `rest`."
)
_FROM_REST = (
    "Starts, goals and horizons of the suite `rest` of the same split, 200 or 100." + _NOTES
)
_FROM_PATHS = (
    "100 goals on recorded paths, made as those of `motion` are, and starts k steps before on them."
    + _NOTES
)


def parts(body: str, split: Split) -> list[Suite]:
    """The suites of a body: of states at rest and, where it has such, of states on paths."""
    rng = np.random.default_rng([SEEDS[split], 2])
    count = _TASKS // (2 if body in MOVES else 1)
    whole = _asked(MAKERS[body](split), count, rng)
    found = [replace(whole, name="parts", notes=_FROM_REST)]
    if body in MOVES:
        cut = _asked(paths_cut(body, split, KS[1:], 4 * _TASKS, rng), count, rng)
        found.append(replace(cut, name="parts-motion", notes=_FROM_PATHS, actions=None))
    return found


def _asked(pool: Suite, count: int, rng: np.random.Generator) -> Suite:
    """So many of its tasks, each with a few components asked, as often each number of them."""
    names = make(pool.body, 1, 0).state_names
    sizes = range(1, min(_MOST, len(names) - 1) + 1)
    tried = pool.only(rng.permutation(np.repeat(np.arange(len(pool.k)), 4)))
    asked = rng.integers(sizes.start, sizes.stop, size=len(tried.k))
    ranks = rng.random((len(tried.k), len(names))).argsort(axis=1).argsort(axis=1)
    weights = np.zeros_like(tried.weights)
    at = [tried.components.index(name) for name in names]
    weights[:, at] = ranks < asked[:, None]
    tried = replace(tried, weights=weights, kinds=tuple(f"{n} asked" for n in asked))
    fine = np.flatnonzero(_hard(tried))
    # The first task of each number of components comes before the second of any.
    turn = [(asked[fine[:i]] == asked[fine[i]]).sum() for i in range(len(fine))]
    return tried.only(np.sort(fine[np.argsort(turn, kind="stable")[:count]]))


def _hard(suite: Suite) -> Bool[np.ndarray, " tasks"]:
    """Whether the start is far from what is asked, and doing nothing never comes near."""
    env = make(suite.body, len(suite.k), 0)

    def off() -> Float[np.ndarray, " tasks"]:
        apart = metrics.differences(
            env.scored(env.observe())[None], env.scored(suite.goals), suite.sigma
        )
        return metrics.largest(apart, suite.weights)[0]

    suite.begin(env, 0)
    fine = off() > 1.0
    for _ in range(int(suite.horizons.max())):
        env.step(np.zeros(env.action_space.shape))
        fine &= off() > _EASY
    return fine
