"""The candidate whose worst outcome is best (eq. 3), by as few evaluations of V as decide it."""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

Evaluate = Callable[[Float[Array, "pairs n s"], Float[Array, "pairs s"]], Float[Array, "pairs n"]]
"""Returns of n imagined next states for each of several (s, g), given these and the goals."""

_ROWS = {"cpu": 4096}
"""Evaluations at a time: as many as a cache holds, or else enough for any accelerator."""


def block_size(pairs: int, each: int) -> int:
    """How many pairs with `each` evaluations to take at a time, a divisor of `pairs`."""
    most = max(1, _ROWS.get(jax.default_backend(), 2**18) // each)
    return next(size for size in range(min(most, pairs), 0, -1) if pairs % size == 0)


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


def best_worst_case(
    evaluate: Evaluate,
    next_states: Float[Array, "pairs candidates N s"],
    goals: Float[Array, "pairs s"],
) -> tuple[Int[Array, " pairs"], Float[Array, " pairs"], Float[Array, " pairs"]]:
    """For each (s, g), argmax over candidates of the min over N returns, and that one's mean.

    And what share of all returns was evaluated to find it.

    Exact, the first of equals included, but for the rounding of V in blocks of different shapes:
    once all N returns of one candidate are known, any other with a single lower return is out. So
    every candidate is asked for one return; the best by that, the leader, for all N; the others for
    the outcome that was the leader's worst, as they share its noises; and for all N only those that
    still stand, which are few.
    """
    pairs, candidates, N, size = next_states.shape
    every = jnp.arange(pairs, dtype=jnp.int32)
    first = evaluate(next_states[:, :, 0], goals)
    leader = first.argmax(axis=1).astype(jnp.int32)
    leading = evaluate(next_states[every, leader], goals)
    hardest, bar = leading.argmin(axis=1), leading.min(axis=1)[:, None]
    bound = jnp.minimum(first, evaluate(next_states[every, :, hardest], goals))

    index = jnp.arange(candidates, dtype=jnp.int32)[None]
    leads = index == leader[:, None]
    stands = jnp.where(index < leader[:, None], bound >= bar, bound > bar) & ~leads
    worst = jnp.where(leads, bar, -jnp.inf).ravel()
    mean = jnp.where(leads, leading.mean(axis=1)[:, None], 0.0).ravel()
    worst, mean = _ask_those_who_stand(
        evaluate, stands.ravel(), next_states.reshape(-1, N, size), goals, worst, mean
    )
    best = worst.reshape(pairs, candidates).argmax(axis=1).astype(jnp.int32)
    evaluated = 2 * candidates + N + N * stands.sum(axis=1, dtype=jnp.float32)
    return best, mean.reshape(pairs, candidates)[every, best], evaluated / (candidates * N)


def _ask_those_who_stand(
    evaluate: Evaluate,
    stands: Bool[Array, " all"],
    next_states: Float[Array, "all N s"],
    goals: Float[Array, "pairs s"],
    worst: Float[Array, " all"],
    mean: Float[Array, " all"],
) -> tuple[Float[Array, " all"], Float[Array, " all"]]:
    """Worst and mean of all N returns, filled in for the candidates that stand, in blocks."""
    total, N, _ = next_states.shape
    size = block_size(goals.shape[0], N)
    blocks = math.ceil(total / size)
    # Slots beyond the last one that stands lie outside, where nothing is written.
    (slots,) = jnp.nonzero(stands, size=blocks * size, fill_value=total)
    slots = slots.astype(jnp.int32)

    def ask(
        block: Int[Array, ""] | int, known: tuple[Float[Array, " all"], Float[Array, " all"]]
    ) -> tuple[Float[Array, " all"], Float[Array, " all"]]:
        worst, mean = known
        asked = jax.lax.dynamic_slice(slots, (block * size,), (size,))
        inside = jnp.minimum(asked, total - 1)
        returns = evaluate(next_states[inside], goals[inside * goals.shape[0] // total])
        return (
            worst.at[asked].set(returns.min(axis=1), mode="drop"),
            mean.at[asked].set(returns.mean(axis=1), mode="drop"),
        )

    needed = (stands.sum(dtype=jnp.int32) + size - 1) // size
    return jax.lax.fori_loop(jnp.zeros((), jnp.int32), needed, ask, (worst, mean))
