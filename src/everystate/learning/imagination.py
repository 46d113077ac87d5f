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
from everystate.learning.policy import worst
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
    """What the ways of each (s, g) tell."""

    worst: Float[Array, "batch steps s"]
    """z of the outcomes on the worst of them, which is the one to make better (eq. 3)."""
    states: Float[Array, "batch states s"]
    """Of one way, that on which V learns."""


Way = Callable[
    [Float[Array, " s"], Float[Array, " s"], Float[Array, "steps s"]],
    tuple[Float[Array, "states s"], Float[Array, " states"], Float[Array, ""]],
]
"""From s, g and z of the outcomes: the states on the way, how near they are, and V at its end."""


def way_of(
    config: Config,
    models: Any,
    policy: Callable[[Float[Array, " s"], Float[Array, " s"]], Float[Array, " a"]],
    target_value: Callable,
    aim: Objective,
    pairs: int,
) -> Way:
    """How a policy goes by d.

    Args:
        config: hyper-parameters.
        models: anything with `state_flow` and `dynamics`, as in `Models`.
        policy: the centre of pi, which acts at every step, as the agent will.
        target_value: V_targ(s, g).
        aim: what V counts.
        pairs: (s, g) in the loss, which has the mean over them, times `imagined_weight`: so a
            gradient is shortened as `within` has it.
    """
    steepest = config.steepest * config.imagined_weight / pairs

    def way(state: Array, goal: Array, latents: Array) -> tuple[Array, Array, Array]:
        def act(_: Array, s: Float[Array, " s"]) -> Float[Array, " a"]:
            return within(policy(s, goal), steepest)

        states = rolled(models, act, state, latents)
        near = nearness(config, models, aim, states, goal)
        return states, near, aim.read(target_value(states[-1], goal))

    return way


def imagined(
    config: Config,
    aim: Objective,
    way: Way,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    *,
    key: PRNGKeyArray,
) -> Imagined:
    """For each (s, g), scaled, N ways of `imagined_steps` steps, or one if `aim` has no caution."""

    def of_one(state: Array, goal: Array, latents: Float[Array, "ways steps s"]) -> Imagined:
        ways, near, last = jax.vmap(lambda z: way(state, goal, z))(latents)
        returns = jax.vmap(aim.climbed)(near, last)
        return Imagined(latents[worst(config, returns)], ways[0])

    pairs, size = states.shape
    count = config.N if aim.cautious else 1
    latents = jax.random.normal(key, (pairs, count, config.imagined_steps, size))
    return jax.vmap(of_one)(states, goals, latents)


def counted(
    config: Config,
    models: Any,
    target_value: Callable,
    aim: Objective,
    states: Float[Array, "batch states s"],
    goals: Float[Array, "batch s"],
) -> tuple[Float[Array, "batch n s"], Float[Array, "batch n"]]:
    """Where V learns on these ways, and what it is there: reaching ends the count as it has it.

    At s, and at every `value_stride`-th state from there [D42].
    """

    def of_one(way: Float[Array, "states s"], goal: Float[Array, " s"]) -> Float[Array, " n"]:
        near = nearness(config, models, aim, way, goal)
        return aim.counted(near, aim.read(target_value(way[-1], goal)))[::stride]

    stride = config.value_stride or config.imagined_steps
    return states[:, :-1:stride], jax.vmap(of_one)(states, goals)


def climbed(
    aim: Objective,
    way: Way,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    latents: Float[Array, "batch steps s"],
) -> Float[Array, " batch"]:
    """For each (s, g) what the policy makes large on the way with these outcomes.

    Reaching ends no count here, as in planning: so the policy cares for what comes after.
    """
    return jax.vmap(lambda *given: aim.climbed(*way(*given)[1:]))(states, goals, latents)
