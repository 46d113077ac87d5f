"""Whole goals for what asks for a part of a state: of many that fit, the best from here."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from everystate.config import Config
from everystate.features import Part
from everystate.learning import replay as rb
from everystate.learning.components import unit
from everystate.learning.facing import Horizontal, inward, outward
from everystate.learning.goals import imagined
from everystate.learning.keys import named
from everystate.learning.models import Models, Scale
from everystate.learning.objectives import PASS, holdable, objectives
from everystate.learning.policy import central
from everystate.learning.state import AgentState
from everystate.learning.ways import rolled

_VISITED, _IMAGINED = 1024, 4096
_CHOICES = 16
_STEPS = 32
_NEAR = 0.3
"""σ within which what is asked is met, as the kernel of the default has it."""
_LASTS = 2.0
"""What it is worth to stay where what is asked is met, beside meeting it."""
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
    """The state as asked, in the body's units, by which what is asked is met soonest and longest.

    Candidates are the states of the atlas that come nearest to what is asked, as many again of
    those to stay in, and the present state; on level ground all turned to face as it does. In each,
    what is asked is set, and the rest left as it is. On the way that the policy goes to each, by d,
    only what is asked counts. So the goal moves on with the body as long as it is chosen anew at
    every step.

    Args:
        config: hyper-parameters.
        models: their policies, d and V.
        scale: the units of the body.
        parts: of the body, as in `everystate.features`.
        atlas: of the agent.
        state: s, in the units of the body.
        components: what is asked of components of the state; NaN where nothing is.
        features: what is asked of features, by name, likewise; none, or of all parts every one.
    """
    asked, here = _Asked(components, features), scale.scaled(state)
    known = _facing_alike(models.dynamics.horizontal, scale, here, atlas.states)
    square = jax.vmap(lambda s: _apart(s, scale, parts, asked))(known)
    nearest = [
        jax.lax.top_k(-jnp.where(among, square, _OUT), _CHOICES)[1]
        for among in (jnp.ones_like(atlas.calm), atlas.calm)
    ]
    candidates = jnp.concatenate([known[jnp.concatenate(nearest)], state[None]])
    candidates = jax.vmap(lambda s: _as_asked(s, parts, asked))(candidates)

    def near(scaled: Float[Array, " s"]) -> Float[Array, ""]:
        square = _apart(scale.unscaled(scaled), scale, parts, asked)
        return jnp.exp(-square / (count * _NEAR**2))

    every = jnp.stack([*features.values(), *components])
    count = jnp.sum(~jnp.isnan(every), dtype=jnp.float32)
    goals = scale.scaled(candidates)
    return candidates[jax.vmap(lambda g: _worth(config, models, near, here, g))(goals).argmax()]


def _facing_alike(
    horizontal: Horizontal,
    scale: Scale,
    here: Float[Array, " s"],
    states: Float[Array, "n s"],
) -> Float[Array, "n s"]:
    """The states, turned until the body faces as it does here: it can be there this way too [D44].

    Else of the few that fit most would ask it to turn round first.
    """

    def turned(state: Float[Array, " s"]) -> Float[Array, " s"]:
        return outward(horizontal, here, inward(horizontal, state, state))

    return scale.unscaled(jax.vmap(turned)(scale.scaled(states))) if horizontal else states


class _Asked(NamedTuple):
    """What is asked of one state: see `completed`."""

    components: Float[Array, " s"]
    features: Mapping[str, Float[Array, ""]]


def _apart(
    state: Float[Array, " s"], scale: Scale, parts: tuple[Part, ...], asked: _Asked
) -> Float[Array, ""]:
    """The squared distance from what is asked, in σ."""
    square = jnp.sum(jnp.nan_to_num((state - asked.components) / scale.spread) ** 2)
    for part in parts:
        read = part.read(state)
        for feature in part.features:
            if feature.name in asked.features:
                off = feature.difference(read[feature.name], asked.features[feature.name])
                square += jnp.nan_to_num(off / feature.spread(scale.spread)) ** 2
    return square


def _as_asked(
    state: Float[Array, " s"], parts: tuple[Part, ...], asked: _Asked
) -> Float[Array, " s"]:
    """The state with what is asked set in it."""

    def with_components(state: Float[Array, " s"]) -> Float[Array, " s"]:
        return jnp.where(jnp.isnan(asked.components), state, asked.components)

    state = with_components(state)
    for part in parts if asked.features else ():
        own = {feature.name: asked.features[feature.name] for feature in part.features}
        now, free = part.read(state), jnp.isnan(jnp.stack(list(own.values()))).all()
        wanted = {name: jnp.where(jnp.isnan(x), now[name], x) for name, x in own.items()}
        state = jnp.where(free, state, part.set(state, wanted))
    return with_components(state)  # a heading that was set has turned the velocity with it


def _worth(
    config: Config,
    models: Models,
    near: Callable[[Float[Array, " s"]], Float[Array, ""]],
    here: Float[Array, " s"],
    goal: Float[Array, " s"],
) -> Float[Array, ""]:
    """How well and how soon what is asked is met on the way to a whole goal, and for how long.

    As the objectives count [D31], with what is asked in the place of the goal. V of passing says no
    more than what comes after the way, so it decides where nothing is met on any: one component in
    thirty that is off is less than it is wrong by, and the best of many that it promises is one
    that it is wrong about.
    """

    def act(_: Array, s: Float[Array, " s"]) -> Float[Array, " a"]:
        return central(config, models, s, goal)

    way = rolled(models, act, here, jnp.zeros((_STEPS, here.size)))
    met = jax.vmap(near)(way[1:])
    fades = config.discount ** jnp.arange(float(_STEPS))
    hit = jnp.max(fades * met)
    if len(models.values) > PASS:
        after = objectives(config)[PASS].read(models.values[PASS](way[-1], goal))
        hit = jnp.maximum(hit, config.discount**_STEPS * after)
    return hit + _LASTS * jnp.mean(met)
