"""Ways through d: what improvement, imagination and search all judge by."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from everystate.hyperparameters import Returns
from everystate.learning.flows import decode
from everystate.learning.objectives import Objective
from everystate.learning.rewards import placing

Act = Callable[[Int[Array, ""], Float[Array, " s"]], Float[Array, " a"]]
"""The action at a step, of which the first is 0, in a state."""
_FAR = 8.0
"""Scaled units. d has seen nothing like it, and its gradients there have no end."""


def rolled(
    models: Any, act: Act, state: Float[Array, " s"], latents: Float[Array, "steps s"]
) -> Float[Array, "states s"]:
    """The states of a way of so many steps by d, that where it begins included, scaled.

    Args:
        models: anything with `dynamics`, as in `Models`.
        act: what is done.
        state: where it begins.
        latents: z of each outcome.
    """

    def one(s: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        step, latent = now
        after = decode(models.dynamics(s, act(step, s)), latent)
        after = jnp.clip(after, -_FAR, _FAR)
        return after, after

    steps = jnp.arange(len(latents), dtype=jnp.int32)
    return jnp.concatenate([state[None], jax.lax.scan(one, state, (steps, latents))[1]])


def nearness(
    config: Returns,
    models: Any,
    aim: Objective,
    states: Float[Array, "states s"],
    goal: Float[Array, " s"],
) -> Float[Array, " states"]:
    """How near each state of a way is to its goal, as an objective has it.

    Args:
        config: hyper-parameters.
        models: anything with `state_flow` and `dynamics`, as in `Models`.
        aim: the objective.
        states: scaled.
        goal: g, scaled.
    """
    place = placing(config, models)
    place_goal = place(goal)
    return jax.vmap(lambda state: aim.closeness(place(state), place_goal))(states)
