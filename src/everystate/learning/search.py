"""The candidate whose worst outcome is best (eq. 3), by as few evaluations of V as decide it."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

Evaluate = Callable[[Float[Array, "pairs n s"], Float[Array, "pairs s"]], Float[Array, "pairs n"]]
"""Returns of n imagined next states for each of several (s, g), given these and the goals."""

_ROWS = {"cpu": 4096}
"""Evaluations at a time: as many as a cache holds, or else enough for any accelerator."""


def block_size(pairs: int, each: int) -> int:
    """How many pairs with `each` evaluations to take at a time: all blocks alike, if that can be.

    A rest would be compiled on its own, but a prime number of pairs must not go one by one.
    """
    most = min(pairs, max(1, _ROWS.get(jax.default_backend(), 2**18) // each))
    return next((size for size in range(most, most // 2, -1) if pairs % size == 0), most)


def blocked(
    returns: Callable[[Float[Array, " s"], Float[Array, " s"]], Float[Array, ""]],
) -> Evaluate:
    """An `Evaluate` of a function of one next state and one goal, block by block."""

    def evaluate(
        next_states: Float[Array, "pairs n s"], goals: Float[Array, "pairs s"]
    ) -> Float[Array, "pairs n"]:
        pairs, each, _ = next_states.shape
        return jax.lax.map(
            lambda pair: jax.vmap(returns, in_axes=(0, None))(*pair),
            (next_states, goals),
            batch_size=block_size(pairs, each),
        )

    return evaluate


class _Known(NamedTuple):
    """Of which candidates all N returns are known, and what these are."""

    asked: Bool[Array, "pairs candidates"]
    """Whether all N are known."""
    worst: Float[Array, "pairs candidates"]
    """Their min, -inf where they are not."""
    mean: Float[Array, "pairs candidates"]


def best_worst_case(
    evaluate: Evaluate,
    next_states: Float[Array, "pairs candidates N s"],
    goals: Float[Array, "pairs s"],
) -> tuple[Int[Array, " pairs"], Float[Array, " pairs"], Float[Array, " pairs"]]:
    """For each (s, g), argmax over candidates of the min over N returns, and that one's mean.

    And what share of all returns was evaluated to find it.

    Exact, the first of equals included, but for the rounding of V in blocks of different shapes:
    once all N returns of one candidate are known, any other with a single lower return is out. So
    every candidate is asked for one return; the best by that for all N; and everyone for what was
    the worst outcome for it, as they share its noises. While others still stand, the best of these
    is asked for all N: mostly once at most.
    """
    pairs, candidates, N, _ = next_states.shape
    every = jnp.arange(pairs, dtype=jnp.int32)
    index = jnp.arange(candidates, dtype=jnp.int32)[None]
    first = evaluate(next_states[:, :, 0], goals)
    leader = first.argmax(axis=1)
    returns = evaluate(next_states[every, leader], goals)
    hardest = evaluate(next_states[every, :, returns.argmin(axis=1)], goals)
    bound = jnp.minimum(first, hardest)
    leads = index == leader.astype(jnp.int32)[:, None]
    known = _Known(
        asked=leads,
        worst=jnp.where(leads, returns.min(axis=1)[:, None], -jnp.inf),
        mean=jnp.where(leads, returns.mean(axis=1)[:, None], 0.0),
    )

    def stand(known: _Known) -> Bool[Array, "pairs candidates"]:
        """Who may still have the best worst case."""
        holder = known.worst.argmax(axis=1).astype(jnp.int32)[:, None]
        bar = known.worst.max(axis=1)[:, None]
        return ~known.asked & jnp.where(index < holder, bound >= bar, bound > bar)

    def challenge(known: _Known) -> _Known:
        standing = stand(known)
        best = jnp.where(standing, bound, -jnp.inf).argmax(axis=1).astype(jnp.int32)
        asked = standing & (index == best[:, None])
        return _ask(evaluate, next_states, goals, asked, known)

    known = jax.lax.while_loop(lambda known: stand(known).any(), challenge, known)
    best = known.worst.argmax(axis=1).astype(jnp.int32)
    evaluated = 2 * candidates + N * known.asked.sum(axis=1, dtype=jnp.float32)
    return best, known.mean[every, best], evaluated / (candidates * N)


def _ask(
    evaluate: Evaluate,
    next_states: Float[Array, "pairs candidates N s"],
    goals: Float[Array, "pairs s"],
    asked: Bool[Array, "pairs candidates"],
    known: _Known,
) -> _Known:
    """With all N returns of the candidates asked, at most one for each (s, g), block by block."""
    pairs, _, N, _ = next_states.shape
    size = block_size(pairs, N)
    # Places beyond the last pair that is asked lie outside, where nothing is written.
    (rows,) = jnp.nonzero(asked.any(axis=1), size=pairs, fill_value=pairs)
    rows, columns = rows.astype(jnp.int32), asked.argmax(axis=1).astype(jnp.int32)

    def block(i: Int[Array, ""] | int, known: _Known) -> _Known:
        # The last block may begin within the one before: what it asks again is the same.
        row = jax.lax.dynamic_slice(rows, (i * size,), (size,))
        inside = jnp.minimum(row, pairs - 1)
        column = columns[inside]
        returns = evaluate(next_states[inside, column], goals[inside])
        return known._replace(
            worst=known.worst.at[row, column].set(returns.min(axis=1), mode="drop"),
            mean=known.mean.at[row, column].set(returns.mean(axis=1), mode="drop"),
        )

    needed = (asked.sum(dtype=jnp.int32) + size - 1) // size
    known = known._replace(asked=known.asked | asked)
    return jax.lax.fori_loop(jnp.zeros((), jnp.int32), needed, block, known)
