"""How much each component of a state counts, as found from what was visited [D39]."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from everystate.learning.dynamics import Dynamics
from everystate.learning.replay import Transitions

_ROUNDING = 1e-6
_NOISE, _FORESEEN = 0.25, 0.75
"""Shares of a component's variance: it counts for nothing below the one, fully above the other."""
_SAME = 16
"""Power of the squared correlation: only what is the same but for a hundredth counts as one."""


def counted(dynamics: Dynamics, t: Transitions) -> Float[Array, " s"]:
    """The weights of the components, in [0, 1].

    0 for what never changes in a step, like the place of a target or a mass: no action leads to
    another copy's. 0 for noise, like most contact forces: what neither d nor the state itself can
    tell of the state that follows. Components that are the same share the weight of one.

    Args:
        dynamics: d.
        t: transitions [n, ...], scaled.
    """
    before, after = t.observations, t.next_observations
    moves = (jnp.abs(after - before) > _ROUNDING * (1 + jnp.abs(before))).any(axis=0)
    spread = jnp.maximum(jnp.std(after, axis=0), _ROUNDING)
    guesses = before, jax.vmap(dynamics.central)(before, t.actions)
    errors = jnp.stack([jnp.mean((after - guess) ** 2, axis=0) for guess in guesses])
    foreseen = 1 - errors.min(axis=0) / spread**2
    weights = jnp.clip((foreseen - _NOISE) / (_FORESEEN - _NOISE), 0, 1)
    weights = jnp.where(moves, weights, 0)
    apart = (after - jnp.mean(after, axis=0)[None]) / spread[None]
    # Of a single component XLA made NaN of a whole power of the product as it stands.
    alike = jnp.clip(jnp.abs(apart.T @ apart) / len(after), 0, 1) ** (2.0 * _SAME)
    return weights / jnp.maximum(alike @ weights, 1)


def factors(weights: Float[Array, " s"]) -> Float[Array, " s"]:
    """By what differences are multiplied, so that squared they have these weights, of mean 1."""
    return jnp.sqrt(weights / jnp.maximum(jnp.mean(weights), _ROUNDING))


def unit(dynamics: Dynamics) -> Float[Array, " s"]:
    """What a change is measured in: that of a step, or more for what counts for less."""
    return dynamics.scale / factors(jax.lax.stop_gradient(dynamics.weights))


def asked(
    weights: Float[Array, " s"], states: Float[Array, "*n s"], goals: Float[Array, "*n s"]
) -> Float[Array, "*n s"]:
    """The goals with the states' own in the place of what counts for nothing."""
    return jnp.where(jnp.broadcast_to(weights > 0, goals.shape), goals, states)
