"""What the policy would gain over some imagined steps, which it can climb by itself [D25].

Stochastic value gradients, SVG(n) of Heess et al. (2015), with d as the model.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning.flows import decode
from everystate.learning.objectives import Objective
from everystate.learning.rewards import placing

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


class Imagined(NamedTuple):
    """What the same imagined steps are worth, by two counts."""

    climbed: Float[Array, " batch"]
    """Reaching may end no count here, as in planning: so the policy cares for what comes after."""
    counted: Float[Array, " batch"]
    """What V is before these steps: reaching ends the count as V has it [D10]."""


def imagined_returns(
    config: Config,
    models: Any,
    policy: Callable[[Float[Array, " s"], Float[Array, " s"]], Float[Array, " a"]],
    target_value: Callable,
    aim: Objective,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    *,
    key: PRNGKeyArray,
) -> Imagined:
    """For each (s, g) the rewards of `imagined_steps` steps by d, and V_targ after them.

    Their gradient is meant for a loss that has them with a minus: see `within`.

    Args:
        config: hyper-parameters.
        models: anything with `state_flow` and `dynamics`, as in `Models`.
        policy: the centre of pi, which acts at every step, as the agent will.
        target_value: V_targ(s, g).
        aim: what V counts.
        states: s, scaled.
        goals: g, scaled.
        key: of the samples of d.
    """

    def of_one(state: Float[Array, " s"], goal: Float[Array, " s"], key: PRNGKeyArray) -> Imagined:
        def step(state: Array, key: PRNGKeyArray) -> tuple[Array, Array]:
            outcomes = models.dynamics(state, within(policy(state, goal)))
            after = decode(outcomes, jax.random.normal(key, outcomes.shape))
            after = jnp.clip(after, -_FAR, _FAR)
            return after, aim.closeness(place(after), place(goal))

        last, near = jax.lax.scan(step, state, jax.random.split(key, steps))
        near = jnp.concatenate([aim.closeness(place(state), place(goal))[None], near])
        known = aim.read(target_value(last, goal))
        return Imagined(aim.climbed(near, known), aim.counted(near, known))

    place, steps = placing(config, models), config.imagined_steps
    return jax.vmap(of_one)(states, goals, jax.random.split(key, len(states)))
