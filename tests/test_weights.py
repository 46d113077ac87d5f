"""Weights of a buffer: what is drawn, and that new weights leave nothing of the old ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from everystate.learning.weights import (
    AS_THEY_ARE,
    WIDTH,
    Tempering,
    draw,
    effective_sample_size,
    median,
    no_weights,
    refresh,
    tempered,
    weigh,
)


def weighed(log_weights, how=AS_THEY_ARE):
    """As a buffer of so many slots holds them."""
    padded = no_weights(log_weights.size).log.at[: log_weights.size].set(jnp.float32(log_weights))
    return weigh(padded, how)


def drawn(log_weights, count, *, key):
    return draw(weighed(log_weights), AS_THEY_ARE, count, key=key)


def gaps(values):
    """Log-weights with some slots of no weight, at the ends as well."""
    return np.where(np.arange(values.size) % 3 == 0, -np.inf, values)


RANDOM = np.random.default_rng(0)
LOG_WEIGHTS = {
    "equal": np.zeros(203),
    "moderate": RANDOM.normal(0, 1, 203),
    "huge spread": RANDOM.normal(0, 20, 203),
    "huge values": RANDOM.normal(0, 1, 203) + 500,
    "gaps": gaps(RANDOM.normal(0, 1, 202)),
    "half filled": np.where(np.arange(203) < 100, RANDOM.normal(0, 1, 203), -np.inf),
    "one slot": np.where(np.arange(203) == 117, -40.0, -np.inf),
    "capacity 1": np.zeros(1),
}


@pytest.mark.parametrize("name", LOG_WEIGHTS)
def test_draws_match_weights(name):
    log_weights, count = LOG_WEIGHTS[name], 100_000
    slots = np.asarray(drawn(log_weights, count, key=jax.random.key(0)))
    assert slots.shape == (count,)
    assert slots.min() >= 0
    assert slots.max() < log_weights.size
    weights = np.exp(log_weights - log_weights.max())
    observed = np.bincount(slots, minlength=weights.size).astype(float)
    assert observed[weights == 0].sum() == 0
    expected = count * weights / weights.sum()
    # Chi-square wants at least five expected counts a cell, so the rare slots share one.
    rare = expected < 5
    cells = np.append(expected[~rare], expected[rare].sum())
    counts = np.append(observed[~rare], observed[rare].sum())
    if cells[-1] < 5:
        assert counts[-1] <= stats.poisson.isf(1e-4, cells[-1])
        cells, counts = cells[:-1], counts[:-1]
    if cells.size > 1:
        cells *= counts.sum() / cells.sum()
        assert stats.chisquare(counts, cells).pvalue > 1e-3


def test_no_point_of_the_unit_interval_draws_an_empty_slot(monkeypatch):
    """The points where rounding could carry a draw over an edge, rather than random ones."""
    for seed in range(5):
        random = np.random.default_rng(seed)
        weights = np.where(random.random(203) < 0.6, 0, np.exp(random.normal(0, 3, 203)))
        edges = np.cumsum(weights) / weights.sum()
        points = [np.zeros(1), np.float32(edges), np.full(1, 1 - 2**-24)]
        around = np.concatenate([np.nextafter(np.float32(edges), np.float32(x)) for x in (0, 1)])
        points = np.clip(np.concatenate([*points, around]), 0, 1 - 2**-24)
        monkeypatch.setattr(
            jax.random, "uniform", lambda *_, points=points: jnp.asarray(points, jnp.float32)
        )
        with np.errstate(divide="ignore"):
            log_weights = jnp.asarray(np.log(weights), jnp.float32)
        slots = np.asarray(drawn(log_weights, points.size, key=jax.random.key(0)))
        assert np.all(weights[slots] > 0)


def test_median_is_over_filled_slots():
    filled = jnp.array([5.0, -3.0, 100.0, 1.0, 2.0])
    empty = jnp.full(7, -jnp.inf)
    assert float(median(filled)) == 2
    assert float(median(jnp.concatenate([empty, filled]))) == 2
    assert 1 <= float(median(jnp.concatenate([filled[:4], empty]))) <= 5
    assert float(median(jnp.array([-jnp.inf, 3.0]))) == 3


def held_around_ten(log, how):
    return tempered(no_weights(1)._replace(log=log, centre=jnp.array(10.0)), how)


def test_weights_are_tempered_and_clipped_around_the_median():
    log_weights = jnp.array([-jnp.inf, -100.0, 6.0, 10.0, 12.0, jnp.inf])
    held = held_around_ten(log_weights, Tempering(0.5, 8.0))
    np.testing.assert_allclose(held, [-np.inf, -8, -2, 0, 1, 8])
    exact = held_around_ten(log_weights[:-1], AS_THEY_ARE)
    np.testing.assert_allclose(exact, [-np.inf, -110, -4, 0, 2])
    flat = held_around_ten(log_weights[:-1], Tempering(0.0, 8.0))
    np.testing.assert_allclose(flat, [-np.inf, 0, 0, 0, 0])


def test_effective_sample_size_counts_equal_weights():
    empty = jnp.full(5, -jnp.inf)
    assert float(effective_sample_size(jnp.full(7, 300.0))) == pytest.approx(7)
    equal = jnp.concatenate([jnp.full(7, -2.0), empty])
    assert float(effective_sample_size(equal)) == pytest.approx(7)
    dominant = jnp.concatenate([jnp.zeros(6), jnp.array([100.0])])
    assert float(effective_sample_size(dominant)) == pytest.approx(1)
    two = jnp.log(jnp.array([1.0, 3.0]))
    assert float(effective_sample_size(two)) == pytest.approx(16 / 10)


SIZE = WIDTH**2 + 3 * WIDTH + 5  # more than a group, and no whole block at the end


@pytest.mark.parametrize("how", [AS_THEY_ARE, Tempering(0.5, 2.0)])
def test_refreshed_sums_are_those_of_all_weights_anew(how):
    random = np.random.default_rng(1)
    weights = weighed(random.normal(0, 3, SIZE), how)
    slots = jnp.asarray(random.integers(0, SIZE, 500), jnp.int32)
    new = (slots % 7).astype(jnp.float32)  # the same for a slot that comes twice
    after = refresh(weights, how, slots, new)
    expected = weights.log.at[slots].set(new)
    np.testing.assert_array_equal(after.log, expected)
    held = np.exp(np.asarray(tempered(after, how)) - float(after.reference))
    blocks = held.reshape(-1, WIDTH).sum(axis=1)
    np.testing.assert_allclose(after.blocks[: len(blocks)], blocks, rtol=1e-5)
    assert not after.blocks[len(blocks) :].any()
    groups = np.asarray(after.blocks).reshape(-1, WIDTH).sum(axis=1)
    np.testing.assert_allclose(after.groups, groups, rtol=1e-5)


def test_a_weight_far_above_all_others_is_drawn_alone():
    weights = weighed(np.zeros(SIZE))
    slot = jnp.array([WIDTH**2 + 17], jnp.int32)
    after = refresh(weights, AS_THEY_ARE, slot, jnp.array([1000.0]))
    assert np.isfinite(after.groups).all()
    assert set(np.asarray(draw(after, AS_THEY_ARE, 1000, key=jax.random.key(0)))) == {int(slot[0])}


def test_the_median_is_that_of_sorting():
    values = np.float32(np.random.default_rng(2).normal(0, 50, 1001))
    assert float(median(jnp.asarray(values))) == np.sort(values)[500]
    same = jnp.full(10, -0.25)
    assert float(median(same)) == -0.25
