"""Units that follow what the body learns to do [D33]."""

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning import replay as rb
from everystate.learning.components import counted
from everystate.learning.facing import Horizontal, about_zero, alike
from everystate.learning.keys import named
from everystate.learning.models import Models, Scale
from everystate.learning.state import AgentState

_ROUNDING = 1e-6
_DRAWN = 4096
_OUTGROWN = 1.5
"""Spreads above which a unit grows that has settled."""
_SETTLING = 5.0
"""Epochs after which a unit grows by no more than an eighth of itself."""


def of_warm_up(states: Float[Array, "steps bodies s"], horizontal: Horizontal = ()) -> Scale:
    """The mean and the spread of what was visited; 1 for what did not move."""
    spread = jnp.std(states, axis=(0, 1))
    moved = spread > _ROUNDING * jnp.max(jnp.abs(states), axis=(0, 1))
    centre = about_zero(horizontal, jnp.mean(states, axis=(0, 1)))
    return Scale(centre, alike(horizontal, jnp.where(moved, spread, 1.0)))


def sound(found: Float[Array, " s"], known: Float[Array, " s"]) -> Float[Array, " s"]:
    """What was found, or what was known where that is not finite."""
    return jnp.where(jnp.isfinite(found), found, known)


def grown(
    config: Config, state: AgentState, *, key: PRNGKeyArray
) -> tuple[AgentState, dict[str, Float[Array, ""]]]:
    """The same in units that have followed what was visited.

    Each unit grows to the spread of goals drawn from the buffer, which weighs what is rarely
    visited more, but after n epochs by no more than (1 + n / 5)^-3 of itself, or 1 / n where that
    has outgrown it by half; none ever shrinks. The centre moves to the mean, and settles. The
    networks are left as they are and have to follow, and averages of weights that lag behind are
    wrong by as much as the units have moved since: most of all where the body is all but still,
    which is near the centre of its velocities. All else that is kept in units moves with them. How
    much each component counts is found from the same transitions [D39]. What is not finite in the
    buffer moves nothing.
    """
    seen = rb.visited_goals(config, state.replay, _DRAWN, key=named(key, "seen"))
    horizontal = state.models.dynamics.horizontal
    spread = alike(horizontal, jnp.std(seen, axis=0))
    epoch = state.epoch.astype(jnp.float32)
    settling = (1 + epoch / _SETTLING) ** -3
    middle = about_zero(horizontal, jnp.mean(seen, axis=0))
    shift = settling / (1 + settling) * sound(middle, jnp.zeros_like(middle))

    def outgrown(spread: Float[Array, " s"]) -> Float[Array, " s"]:
        most = jnp.where(spread > _OUTGROWN, 1 / (1 + epoch), settling)
        return jnp.clip(spread, 1.0, 1 + jnp.maximum(most, settling))

    factor = outgrown(sound(spread, jnp.ones_like(spread)))

    def moved(states: Float[Array, "n s"]) -> Float[Array, "n s"]:
        kept = states.shape[1] > 0  # A ring that keeps no goals has none to move.
        return (states - shift[None]) / factor[None] if kept else states

    t = state.replay.transitions
    replay = state.replay._replace(
        transitions=t._replace(
            observations=moved(t.observations),
            next_observations=moved(t.next_observations),
            goals=moved(t.goals),
        )
    )
    drawn = rb.drawn_transitions(config, state.replay, _DRAWN, key=named(key, "drawn"))
    changes = drawn.next_observations - drawn.observations
    change = alike(horizontal, jnp.std(changes, axis=0)) / factor
    same = state.models.dynamics.change_scale / factor
    of_step = same * outgrown(sound(change / same, jnp.ones_like(same)))
    known = state.models.dynamics.weights
    weights = sound(alike(horizontal, counted(state.kept.dynamics, drawn)), known)

    def in_units(models: Models) -> Models:
        dynamics = replace(models.dynamics, change_scale=of_step, weights=weights)
        return models._replace(dynamics=dynamics)

    centre, spreads = state.scale
    state = state._replace(
        scale=Scale(centre + shift * spreads, spreads * factor),
        replay=replay,
        episodes=state.episodes._replace(goals=moved(state.episodes.goals)),
        models=in_units(state.models),
        average=None if state.average is None else in_units(state.average),
    )
    return state, {
        "units/growth": jnp.max(factor),
        "units/largest": jnp.max(spread),
        "units/counted": jnp.sum(weights),
    }
