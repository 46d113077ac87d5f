"""Weights of a buffer's items, as logs, from which drawing costs the same however many there are.

In float32 the linear weights 1/p_f underflow. Sums of the weights over blocks of slots, and over
groups of blocks, are kept beside the logs: a draw looks into one group and one block, and a new
weight changes the sums of these alone.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from everystate.hyperparameters import Buffers

WIDTH = 64
"""Slots of a block, and blocks of a group."""

_MOST = 60.0
"""Nats by which a new weight may exceed all former ones: e^60 times 10^8 slots is a float32."""


class Tempering(NamedTuple):
    """How weights are flattened: their exponent, and how far from the median they are held [D1]."""

    exponent: float
    clip: float


AS_THEY_ARE = Tempering(1.0, math.inf)


class Weights(NamedTuple):
    """Log-weights, -inf where a slot is empty, and the sums by which they are drawn from."""

    log: Float[Array, " slots"]
    """Padded to whole blocks."""
    centre: Float[Array, ""]
    """Median log-weight when the sums were last worked out."""
    reference: Float[Array, ""]
    """Largest tempered log-weight then: sums are in units of its exp."""
    blocks: Float[Array, " blocks"]
    """Padded to whole groups."""
    groups: Float[Array, " groups"]


def tempering(config: Buffers) -> Tempering:
    """Of the goals' and the transitions' weights."""
    return Tempering(config.weight_temper, config.weight_clip)


def no_weights(capacity: int) -> Weights:
    """For `capacity` empty slots."""
    blocks = -(-capacity // WIDTH)
    groups = -(-blocks // WIDTH)
    zero = jnp.zeros(())
    log = jnp.full(blocks * WIDTH, -jnp.inf)
    return Weights(log, zero, zero.copy(), jnp.zeros(groups * WIDTH), jnp.zeros(groups))


def tempered(weights: Weights, how: Tempering) -> Float[Array, " slots"]:
    """Log-weights to the power `exponent`, held within `clip` of the median [D1]."""
    return _tempered(weights.log, weights.centre, how)


def weigh(log: Float[Array, " slots"], how: Tempering) -> Weights:
    """All sums anew, in time proportional to the slots."""
    # Without a clip the median would only cancel out.
    centre = median(log) if how.clip < math.inf else jnp.zeros(())
    logs = _tempered(log, centre, how)
    reference = jnp.max(logs)
    # Summed by the function that keeps the sums, so that they do not depend on when.
    blocks = _summed(jnp.exp(logs - reference))
    blocks = jnp.pad(blocks, (0, -blocks.size % WIDTH))
    return Weights(log, centre, reference, blocks, _summed(blocks))


def refresh(
    weights: Weights, how: Tempering, slots: Int[Array, " n"], log: Float[Array, " n"]
) -> Weights:
    """With other weights in some slots, which keep theirs where the new one is not finite."""
    log = jnp.where(jnp.isfinite(log), log, weights.log[slots])
    logs = weights.log.at[slots].set(log)
    weights = weights._replace(log=logs)
    in_blocks = slots // WIDTH
    blocks = weights.blocks.at[in_blocks].set(_linear(weights, how, in_blocks).sum(axis=1))
    in_groups = in_blocks // WIDTH
    groups = weights.groups.at[in_groups].set(blocks.reshape(-1, WIDTH)[in_groups].sum(axis=1))
    return weights._replace(blocks=blocks, groups=groups)


def draw(
    weights: Weights, how: Tempering, count: int, *, key: PRNGKeyArray
) -> Int[Array, " count"]:
    """Slots drawn with replacement, with probability proportional to their tempered weights."""
    ends = jnp.cumsum(weights.groups)
    points = jax.random.uniform(key, (count,)) * ends[-1]
    # Rounding must not carry a point past the last group with any weight.
    last = jnp.searchsorted(ends, ends[-1], side="left")
    group = jnp.minimum(jnp.searchsorted(ends, points, side="right"), last).astype(jnp.int32)
    rest = points - (ends[group] - weights.groups[group])
    within, rest = _find(weights.blocks.reshape(-1, WIDTH)[group], rest)
    block = group * WIDTH + within
    within, _ = _find(_linear(weights, how, block), rest)
    return block * WIDTH + within


def median(log: Float[Array, " slots"]) -> Float[Array, ""]:
    """The lower median of the filled slots' log-weights, by bisection: a sort takes far longer."""
    # Bits of a float, read as an integer, are in the order of the floats once the negative ones are
    # turned round.
    bits = jax.lax.bitcast_convert_type(log, jnp.int32)
    ordered = jnp.where(bits < 0, bits ^ 0x7FFFFFFF, bits)
    filled = jnp.isfinite(log)
    rank = jnp.maximum(filled.sum(dtype=jnp.int32) - 1, 0) // 2

    def halve(_: Array, bounds: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bounds  # The median lies in (low, high].
        middle = (low & high) + ((low ^ high) >> 1)
        enough = (filled & (ordered <= middle)).sum(dtype=jnp.int32) > rank
        return jnp.where(enough, low, middle), jnp.where(enough, middle, high)

    whole = (jnp.full((), -(2**31), jnp.int32), jnp.full((), 2**31 - 1, jnp.int32))
    found = jax.lax.fori_loop(0, 32, halve, whole)[1]
    return jax.lax.bitcast_convert_type(
        jnp.where(found < 0, found ^ 0x7FFFFFFF, found), jnp.float32
    )


def effective_sample_size(log: Float[Array, " slots"]) -> Float[Array, ""]:
    """(sum w)^2 / sum w^2: how many equally weighted items the buffer is worth."""
    weights = jnp.exp(log - jnp.max(log))
    return weights.sum() ** 2 / (weights**2).sum()


def _tempered(
    log: Float[Array, "*slots"], centre: Float[Array, ""], how: Tempering
) -> Float[Array, "*slots"]:
    held = jnp.clip(how.exponent * (log - centre), -how.clip, how.clip)
    return jnp.where(jnp.isneginf(log), -jnp.inf, held)


def _linear(weights: Weights, how: Tempering, blocks: Int[Array, " n"]) -> Float[Array, "n width"]:
    """The weights of the slots of some blocks, in units of exp(reference)."""
    logs = _tempered(weights.log.reshape(-1, WIDTH)[blocks], weights.centre, how)
    return jnp.exp(jnp.minimum(logs - weights.reference, _MOST))


def _summed(values: Float[Array, " n"]) -> Float[Array, " blocks"]:
    return values.reshape(-1, WIDTH).sum(axis=1)


def _find(
    rows: Float[Array, "n width"], points: Float[Array, " n"]
) -> tuple[Int[Array, " n"], Float[Array, " n"]]:
    """Where in its row's running sum each point lies, and by how much beyond what comes before."""
    ends = rows @ jnp.triu(jnp.ones((WIDTH, WIDTH)))
    some = rows > 0
    most = jnp.where(some, ends, 0.0).max(axis=1)
    points = jnp.clip(points, 0.0, most * (1 - 1e-6))
    found = (some & (ends > points[:, None])).argmax(axis=1).astype(jnp.int32)
    before = jnp.take_along_axis(ends - rows, found[:, None], axis=1)[:, 0]
    return found, points - before
