"""The best worst case by few evaluations is the best worst case by all of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from everystate.learning import search
from everystate.learning.search import best_worst_case, block_size, blocked

PAIRS, CANDIDATES, N = 61, 6, 10  # a prime: blocks have a rest


def returns(kind):
    """Made-up returns [pairs, candidates, N]."""
    random = np.random.default_rng(3)
    noise = random.normal(0, 1, (PAIRS, 1, N))
    better = random.normal(0, 1, (PAIRS, CANDIDATES, 1))
    own = random.normal(0, 1, (PAIRS, CANDIDATES, N))
    return {
        "shared noise": better + noise + 0.1 * own,
        "own noise": 0.1 * better + own,
        "many equals": np.round(better + own),
        "all equal": np.zeros((PAIRS, CANDIDATES, N)),
        "last is best": np.arange(CANDIDATES)[None, :, None] + 0.1 * own,
        "one outcome": (better + own)[:, :, :1],
        "one candidate": (better + own)[:, :1],
    }[kind].astype(np.float32)


def itself(next_state, goal):
    """A return for which the imagined next state is its own return."""
    return next_state[0] + goal[0]


KINDS = ("shared noise", "own noise", "many equals", "all equal", "last is best")
KINDS += ("one outcome", "one candidate")


@pytest.mark.parametrize("rows", [4096, 30, 1])
@pytest.mark.parametrize("kind", KINDS)
def test_it_is_that_of_all_returns(monkeypatch, kind, rows):
    monkeypatch.setattr(search, "_ROWS", {"cpu": rows})
    table = returns(kind)
    find = jax.jit(lambda x, g: best_worst_case(blocked(itself), x, g))
    best, mean, evaluated = find(jnp.asarray(table)[..., None], jnp.zeros((PAIRS, 1)))
    expected = table.min(axis=2).argmax(axis=1)  # the first of equals
    np.testing.assert_array_equal(best, expected)
    np.testing.assert_allclose(mean, table[np.arange(PAIRS), expected].mean(axis=1), atol=1e-6)
    assert float(evaluated.min()) > 0
    if kind == "one candidate":  # one return twice, and then all N of it
        np.testing.assert_allclose(evaluated, (2 + N) / N, rtol=1e-6)


def test_few_evaluations_do_where_candidates_share_their_noise():
    """Counted: with a table in the place of V, what is evaluated is what is looked up."""
    counts = []

    def counting(next_states, goals):
        counts.append(int(np.prod(next_states.shape[:2])))
        return next_states[..., 0]

    table = jnp.asarray(returns("shared noise"))[..., None]
    with jax.disable_jit():
        _, _, evaluated = best_worst_case(counting, table, jnp.zeros((PAIRS, 1)))
    assert sum(counts) < 0.7 * table[..., 0].size
    # The last block may be padded.
    assert float(evaluated.mean()) * table[..., 0].size == pytest.approx(sum(counts), abs=PAIRS * N)


@pytest.mark.parametrize(
    ("pairs", "each"), [(1000, 20), (1000, 4), (256, 3), (7, 10_000), (1, 1), (1009, 20)]
)
def test_blocks_fit_the_cache_and_are_no_smaller_than_they_must(pairs, each):
    size = block_size(pairs, each)
    most = min(pairs, max(1, 4096 // each))
    assert most / 2 <= size <= most
    even = [s for s in range(1, most + 1) if pairs % s == 0 and s > most / 2]
    assert size == (max(even) if even else most)
