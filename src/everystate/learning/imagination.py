"""What the policy would gain over some imagined steps, which it can climb by itself [D25].

Stochastic value gradients, SVG(n) of Heess et al. (2015), with d as the model.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning.objectives import Objective
from everystate.learning.ways import nearness, rolled


@partial(jax.custom_vjp, nondiff_argnums=(1,))
def within(action: Float[Array, " a"], steepest: float = math.inf) -> Float[Array, " a"]:
    """The action within [-1, 1], with a gradient beyond for what leads back (in a loss).

    That of a clip is 0 there, and so a policy that was once driven out stayed out: ants on their
    backs pushed with all legs and never tried anything else. Hausknecht and Stone (2016) invert
    gradients for it. A gradient longer than `steepest` is shortened to that [D41].
    """
    return jnp.clip(action, -1, 1)


def _within_bwd(steepest: float, action: Array, cotangent: Array) -> tuple[Array]:
    length = jnp.sqrt(jnp.sum(cotangent**2))
    cotangent *= jnp.where(length > steepest, steepest / length, 1.0)
    return (jnp.where((jnp.abs(action) <= 1) | (cotangent * action > 0), cotangent, 0),)


within.defvjp(lambda action, steepest: (within(action, steepest), action), _within_bwd)


class Imagined(NamedTuple):
    """What the same imagined steps are worth, by two counts."""

    climbed: Float[Array, " batch"]
    """What the policy makes large: reaching ends no count here, so what comes after matters too."""
    states: Float[Array, "batch n s"]
    """Where V learns: s, and every `value_stride`-th state on the way from there [D42]."""
    counted: Float[Array, "batch n"]
    """What V is there: reaching ends the count as V has it [D10]."""


def imagined(
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
    """For each (s, g) what `imagined_steps` steps by d count, with V_targ after them.

    Their gradient is meant for a loss that has the mean of `climbed`, times minus
    `imagined_weight`: see `within`.

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

    def of_one(state: Array, goal: Array, latents: Float[Array, "steps s"]) -> Imagined:
        def act(_: Array, s: Float[Array, " s"]) -> Float[Array, " a"]:
            return within(policy(s, goal), steepest)

        way = rolled(models, act, state, latents)
        near = nearness(config, models, aim, way, goal)
        last = aim.read(target_value(way[-1], goal))
        counted = aim.counted(near, last)[::stride]
        return Imagined(aim.climbed(near, last), way[:-1:stride], counted)

    pairs, size = states.shape
    stride = config.value_stride or config.imagined_steps
    steepest = config.steepest * config.imagined_weight / pairs
    latents = jax.random.normal(key, (pairs, config.imagined_steps, size))
    return jax.vmap(of_one)(states, goals, latents)
