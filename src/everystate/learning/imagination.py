"""What the policy would gain over some imagined steps, which it can climb by itself [D25].

Stochastic value gradients, SVG(n) of Heess et al. (2015), with d as the model.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning.flows import decode
from everystate.learning.rewards import closeness, placing
from everystate.learning.value import bounded, remaining

_FAR = 8.0
"""Scaled units. d has seen nothing like it, and its gradients there have no end."""


@jax.custom_vjp
def within(action: Float[Array, " a"]) -> Float[Array, " a"]:
    """The action within [-1, 1], with a gradient beyond for what leads back (in a loss).

    That of a clip is 0 there, and so a policy that was once driven out stayed out: ants on their
    backs pushed with all legs and never tried anything else. Hausknecht and Stone (2016) invert
    gradients for it.
    """
    return jnp.clip(action, -1, 1)


def _within_bwd(action: Array, cotangent: Array) -> tuple[Array]:
    return (jnp.where((jnp.abs(action) <= 1) | (cotangent * action > 0), cotangent, 0),)


within.defvjp(lambda action: (within(action), action), _within_bwd)


def imagined_returns(
    config: Config,
    models: Any,
    policy: Callable,
    target_value: Callable,
    floor: Float[Array, ""],
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    *,
    key: PRNGKeyArray,
) -> Float[Array, " batch"]:
    """For each (s, g) the rewards of `imagined_steps` steps by d, and V_targ after them.

    Its gradient is meant for a loss that has it with a minus: see `within`.

    Args:
        config: hyper-parameters.
        models: anything with `state_flow` and `dynamics`, as in `Models`.
        policy: pi, which acts at every step, by its centre, as the agent will.
        target_value: V_targ(s, g).
        floor: lowest value that V_targ can have [D4].
        states: s, scaled.
        goals: g, scaled.
        key: of the samples of d.
    """

    def of_one(
        state: Float[Array, " s"], goal: Float[Array, " s"], key: PRNGKeyArray
    ) -> Float[Array, ""]:
        def step(carry: tuple[Array, Array, Array], key: PRNGKeyArray) -> tuple:
            state, total, weight = carry
            actions = policy(state, goal)
            action = within(decode(actions, jnp.zeros(actions.shape)))
            outcomes = models.dynamics(state, action)
            after = decode(outcomes, jax.random.normal(key, outcomes.shape))
            after = jnp.clip(after, -_FAR, _FAR)
            near = closeness(config, place(after), place(goal))
            total += weight * (near - 1)
            return (after, total, weight * remaining(config, near)), None

        begun, keys = (state, jnp.zeros(()), jnp.ones(())), jax.random.split(key, steps)
        (after, total, weight), _ = jax.lax.scan(step, begun, keys)
        return total + weight * bounded(config, target_value(after, goal), floor)

    place, steps = placing(config, models), config.imagined_steps
    return jax.vmap(of_one)(states, goals, jax.random.split(key, len(states)))
