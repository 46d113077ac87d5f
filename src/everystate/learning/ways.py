"""Ways through d: what improvement, imagination and search all judge by."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from everystate.config import Config
from everystate.learning.flows import decode
from everystate.learning.objectives import Objective
from everystate.learning.rewards import placing

Act = Callable[[Int[Array, ""], Float[Array, " s"]], Float[Array, " a"]]
"""The action at a step, of which the first is 0, in a state."""
_FAR = 8.0
"""Scaled units. d has seen nothing like it, and its gradients there have no end."""


class Way(NamedTuple):
    """How near the states of a way are to its goal, and what V_targ says where it ends."""

    near: Float[Array, " states"]
    """h of each, that of where it begins included."""
    last: Float[Array, ""]
    furthest: Float[Array, ""]
    """Largest |component| of its states, in scaled units: how far off the data it leads."""


def rolled(
    config: Config,
    models: Any,
    value: Callable,
    aim: Objective,
    act: Act,
    state: Float[Array, " s"],
    goal: Float[Array, " s"],
    latents: Float[Array, "steps s"],
) -> Way:
    """The way of so many steps by d from s towards g, both scaled.

    Args:
        config: hyper-parameters.
        models: anything with `state_flow` and `dynamics`, as in `Models`.
        value: V_targ(s, g).
        aim: what V counts.
        act: what is done.
        state: s.
        goal: g.
        latents: z of each outcome.
    """

    def one(s: Array, now: tuple[Array, Array]) -> tuple[Array, tuple[Array, Array]]:
        step, latent = now
        after = decode(models.dynamics(s, act(step, s)), latent)
        after = jnp.clip(after, -_FAR, _FAR)
        return after, (aim.closeness(place(after), place_goal), jnp.abs(after).max())

    place = placing(config, models)
    place_goal = place(goal)
    steps = jnp.arange(len(latents), dtype=jnp.int32)
    last, (near, far) = jax.lax.scan(one, state, (steps, latents))
    near = jnp.concatenate([aim.closeness(place(state), place_goal)[None], near])
    return Way(near, aim.read(value(last, goal)), far.max())
