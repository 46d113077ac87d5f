"""Whole goals for what asks for a part of a state: of many that fit, the best from here."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from everystate.config import Config
from everystate.features import Part
from everystate.learning import replay as rb
from everystate.learning.components import unit
from everystate.learning.goals import imagined
from everystate.learning.keys import named
from everystate.learning.models import Models, Scale
from everystate.learning.objectives import HOLD, PASS, holdable, worths
from everystate.learning.state import AgentState

_VISITED, _IMAGINED = 1024, 4096
_CHOICES = 32
_OUT = 1e6
"""Farther than any state is from what is asked."""


class Atlas(NamedTuple):
    """States that the body can be in, in its units."""

    states: Float[Array, "n s"]
    calm: Bool[Array, " n"]
    """Which of them the agent can stay in."""


def visited(config: Config, state: AgentState) -> Float[Array, "n s"]:
    """States for an atlas, in the body's units: drawn as goals are, so also rare and calm ones."""
    key = named(state.key, "atlas", state.epoch)
    of_step = unit(state.models.dynamics)
    slots = rb.goal_slots(config, state.replay, of_step, _VISITED, key=key)
    return state.scale.unscaled(state.replay.transitions.next_observations[slots])


def new_atlas(
    config: Config, models: Models, scale: Scale, states: Float[Array, "n s"] | None
) -> Atlas:
    """Of states that were visited or, where none were kept, of such as f imagines.

    Those imagined lie beside what a body can be in, a cosine of 1.4 for instance, where V is wrong.
    """
    if states is None:
        scaled = imagined(models.state_flow, _IMAGINED, key=jax.random.key(0))
    else:
        scaled = scale.scaled(states)
    calm = jax.vmap(lambda goal: holdable(config, models.values, goal))(scaled)
    return Atlas(scale.unscaled(scaled), calm)


def completed(
    config: Config,
    models: Models,
    scale: Scale,
    parts: tuple[Part, ...],
    atlas: Atlas,
    state: Float[Array, " s"],
    components: Float[Array, " s"],
    features: Mapping[str, Float[Array, ""]],
) -> Float[Array, " s"]:
    """A state as asked, in the body's units: one to stay in if there is one, the nearest by V.

    Candidates are the states of the atlas that come nearest to what is asked, as many again of
    those to stay in, and the present state. In each, what is asked is set, and the rest left as it
    is. So the goal moves on with the body as long as it is chosen anew at every step.

    Args:
        config: hyper-parameters.
        models: their `values`.
        scale: the units of the body.
        parts: of the body, as in `everystate.features`.
        atlas: of the agent.
        state: s, in the units of the body.
        components: what is asked of components of the state; NaN where nothing is.
        features: what is asked of features, by name.
    """
    asked = Asked(components, features)
    square = jax.vmap(lambda s: _apart(s, scale, parts, asked))(atlas.states)
    nearest = [
        jax.lax.top_k(-jnp.where(among, square, _OUT), _CHOICES)[1]
        for among in (jnp.ones_like(atlas.calm), atlas.calm)
    ]
    candidates = jnp.concatenate([atlas.states[jnp.concatenate(nearest)], state[None]])
    candidates = jax.vmap(lambda s: _as_asked(s, parts, asked))(candidates)
    best = _best(config, models, scale.scaled(state), scale.scaled(candidates))
    return candidates[best]


class Asked(NamedTuple):
    """What is asked of one state: see `completed`."""

    components: Float[Array, " s"]
    features: Mapping[str, Float[Array, ""]]


def _apart(
    state: Float[Array, " s"], scale: Scale, parts: tuple[Part, ...], asked: Asked
) -> Float[Array, ""]:
    """The squared distance from what is asked, in σ."""
    square = jnp.sum(jnp.nan_to_num((state - asked.components) / scale.spread) ** 2)
    for part in parts:
        read = part.read(state)
        for feature in part.features:
            if feature.name in asked.features:
                off = feature.difference(read[feature.name], asked.features[feature.name])
                square += (off / feature.spread(scale.spread)) ** 2
    return square


def _as_asked(
    state: Float[Array, " s"], parts: tuple[Part, ...], asked: Asked
) -> Float[Array, " s"]:
    """The state with what is asked set in it."""
    state = jnp.where(jnp.isnan(asked.components), state, asked.components)
    for part in parts:
        if names := [f.name for f in part.features if f.name in asked.features]:
            state = part.set(state, {name: asked.features[name] for name in names})
    return state


def _best(
    config: Config, models: Models, here: Float[Array, " s"], there: Float[Array, "n s"]
) -> Int[Array, ""]:
    """Which of the goals, scaled, costs least: among those to stay in, or else to pass."""
    worth = jax.vmap(lambda goal: worths(config, models.values, here, goal))(there)
    if len(models.values) == 1:
        return worth[:, 0].argmax()
    calm = jax.vmap(lambda goal: holdable(config, models.values, goal))(there)
    held = jnp.where(calm, worth[:, HOLD], -jnp.inf).argmax()
    return jnp.where(calm.any(), held, worth[:, PASS].argmax())
