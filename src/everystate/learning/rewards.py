"""The shaped reward (4.2)."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from everystate.hyperparameters import Returns, RewardShape
from everystate.learning.components import factors
from everystate.learning.flows import encode, frozen

Place = Callable[[Float[Array, " s"]], Float[Array, " place"]]
_ROUNDED = 0.1


def placing(config: Returns, models: Any) -> Place:
    """Where the reward sees a scaled state: at its latent f_enc(s), or at the state itself [D9].

    In all but the latent space components count by their weights [D39]. Two slopes [D45] need the
    state itself, then the state with each component in units of what a step changes it by, so that
    what takes long to change counts for more; the factors of all components have a mean square of
    1.

    Args:
        config: `reward_space`.
        models: anything with `state_flow` and `dynamics`, as in `Models`.
    """
    if config.reward_space == "latent":
        flow = frozen(models.state_flow)
        return lambda state: encode(flow, state)
    weights = jax.lax.stop_gradient(models.dynamics.weights)
    by_state = factors(weights)
    if config.reward_shape == "exponential":
        return lambda state: state * by_state
    by_steps = factors(weights / jax.lax.stop_gradient(models.dynamics.change_scale) ** 2)
    return lambda state: jnp.concatenate([state * by_state, state * by_steps])


def closeness(
    config: Returns,
    place_next: Float[Array, " place"],
    place_goal: Float[Array, " place"],
    shape: RewardShape | None = None,
) -> Float[Array, ""]:
    """exp(-k |f_enc(s') - f_enc(g)|^2), in [0, 1]; the reward is this minus one (4.2).

    In many dimensions that is 0 practically everywhere, unless k falls with their number [D34]. Of
    two slopes one is a cusp, which is felt up to the goal [D38], the other is felt from afar by
    what takes long to change [D45]. Which of them is `reward_shape`, unless `shape` says another.
    """
    off = place_next - place_goal
    parts = jnp.split(off, 2) if config.reward_shape == "two-slopes" else [off]
    width = config.kernel_width
    k = 1 / (parts[0].size * width**2) if width else config.k
    square = k * jnp.sum(parts[0] ** 2)
    if (shape or config.reward_shape) == "exponential":
        return jnp.exp(-square)
    # Rounded, as a slope that turns about at once is no slope at all.
    cusp = jnp.exp(_ROUNDED - jnp.sqrt(square + _ROUNDED**2))
    return (cusp + 1 / (1 + jnp.mean(parts[1] ** 2))) / 2
