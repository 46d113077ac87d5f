"""Units that grow with what the body learns to do [D33]."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning import guard
from everystate.learning import replay as rb
from everystate.learning.keys import named
from everystate.learning.models import Scale
from everystate.learning.state import AgentState

GROWTH = 1.5
"""Units change when some component is spread over this many of its own."""
_LEAST = 1e-3
_ROUNDING = 1e-6
_DRAWN = 4096


def of_warm_up(states: Float[Array, "steps bodies s"]) -> Scale:
    """The mean and the spread of what was visited; 1 for what did not move."""
    spread = jnp.std(states, axis=(0, 1))
    moved = spread > _ROUNDING * jnp.max(jnp.abs(states), axis=(0, 1))
    return Scale(jnp.mean(states, axis=(0, 1)), jnp.where(moved, spread, 1.0))


def grown(
    config: Config, state: AgentState, *, key: PRNGKeyArray
) -> tuple[AgentState, dict[str, Float[Array, ""]]]:
    """The same in larger units, if what was visited has outgrown these by `GROWTH`.

    Spreads are those of goals drawn from the buffer, which weighs what is rarely visited more. All
    components grow at once, to what they are spread over, and none ever shrinks: so units change a
    few times, early in a run, and then stay. All that is kept in units moves but the networks,
    which follow; their average begins anew.
    """
    seen = rb.visited_goals(config, state.replay, _DRAWN, key=named(key, "seen"))
    spread = jnp.std(seen, axis=0)
    grow = jnp.max(spread) > GROWTH
    factor = jnp.where(grow, jnp.maximum(spread, 1.0), 1.0)
    shift = jnp.where(grow, jnp.mean(seen, axis=0), 0.0)

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
    drawn = rb.drawn_transitions(config, replay, _DRAWN, key=named(key, "drawn"))
    change = jnp.std(drawn.next_observations - drawn.observations, axis=0)
    change = jnp.where(grow, jnp.maximum(change, _LEAST), state.models.dynamics.change_scale)
    models = eqx.tree_at(lambda m: m.dynamics.change_scale, state.models, change)
    average = state.average
    if average is not None:
        average = guard.chosen(grow, models, average)
    centre, unit = state.scale
    state = state._replace(
        scale=Scale(centre + shift * unit, unit * factor),
        replay=replay,
        episodes=state.episodes._replace(goals=moved(state.episodes.goals)),
        models=models,
        average=average,
    )
    return state, {"units/grew": grow.astype(jnp.float32), "units/largest": jnp.max(spread)}
