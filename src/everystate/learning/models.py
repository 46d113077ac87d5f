"""The models of Algorithm 1, built together and stepped together."""

import math
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import optax
from flowjax.distributions import AbstractTransformed
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray

from everystate.config import Config
from everystate.hyperparameters import Fitting, Units
from everystate.learning.conditional import Centred, Conditional, conditional_flow
from everystate.learning.dynamics import Dynamics
from everystate.learning.facing import Horizontal, alike
from everystate.learning.flows import state_flow
from everystate.learning.keys import named
from everystate.learning.networks import Value
from everystate.learning.objectives import objectives, readings
from everystate.learning.policy import Policy


class Models(NamedTuple):
    """f(s), d(s'|s,a), pi(a|s,g), c(s|g) and V(s,g), all in scaled units.

    pi are as many as the run has objectives, V as many as it has `readings`.
    """

    state_flow: AbstractTransformed
    dynamics: Dynamics
    policies: tuple[Policy, ...]
    curriculum: Conditional
    values: tuple[Value, ...]


class Scale(NamedTuple):
    """A body's units: a scaled state is (s - centre) / spread."""

    centre: Float[Array, " s"]
    spread: Float[Array, " s"]

    def scaled(self, states: Float[Array, "*batch s"]) -> Float[Array, "*batch s"]:
        """From the body's units."""
        centre, spread = (jnp.broadcast_to(x, states.shape) for x in self)
        return (states - centre) / spread

    def unscaled(self, states: Float[Array, "*batch s"]) -> Float[Array, "*batch s"]:
        """To the body's units."""
        centre, spread = (jnp.broadcast_to(x, states.shape) for x in self)
        return states * spread + centre


class Space(NamedTuple):
    """What models must know of a body."""

    state_size: int
    action_size: int
    horizontal: Horizontal = ()
    """Components that turn with it: see `facing`."""

    def turned(self, config: Units) -> Horizontal:
        """Those that the models turn: none without `any_heading`."""
        return self.horizontal if config.any_heading else ()


def new_models(
    config: Config, space: Space, change_scale: Float[Array, " s"], *, key: PRNGKeyArray
) -> Models:
    """Untrained models of a body whose states change by about `change_scale` per step."""
    state_size, action_size, horizontal = *space[:2], space.turned(config)
    network = {"width": config.width, "depth": config.depth, "frequencies": config.frequencies}

    def conditional(name: str, size: int, condition_size: int, layers: int) -> Conditional:
        return conditional_flow(
            size,
            condition_size,
            layers,
            family=config.flow,
            shifted=config.flow_shift,
            alternate=config.alternate,
            key=named(key, name),
            **network,
        )

    def centred(name: str, size: int, condition_size: int, layers: int) -> Conditional:
        flow = conditional(name, size, condition_size, layers)
        if not config.centres:
            return flow
        return Centred(size, condition_size, flow, key=named(key, f"{name} centre"), **network)

    both, aims = config.both_goals, objectives(config)
    seen = (3 if both else 2) * state_size
    return Models(
        state_flow=state_flow(
            state_size,
            config.state_layers,
            family=config.flow,
            shifted=config.flow_shift,
            alternate=config.alternate,
            key=named(key, "f"),
        ),
        dynamics=Dynamics(
            centred("d", state_size, state_size + action_size, config.dynamics_layers),
            alike(horizontal, change_scale),
            jnp.ones_like(change_scale),
            horizontal,
        ),
        policies=tuple(
            Policy(
                centred(f"pi{aim.suffix}", action_size, seen, config.policy_layers),
                both,
                horizontal,
            )
            for aim in aims
        ),
        curriculum=conditional("c", state_size, state_size, config.curriculum_layers),
        values=tuple(
            Value(
                state_size,
                both=both,
                horizontal=horizontal,
                key=named(key, f"V{reading.suffix}"),
                **network,
            )
            for reading in readings(aims)
        ),
    )


def new_optimisers(config: Fitting, models: Models) -> tuple[optax.OptState, ...]:
    """Adam's state for each model."""
    every = zip(Models._fields, models, strict=True)
    return tuple(_adam(config, name).init(trainable(model)) for name, model in every)


def step(
    config: Fitting, models: Models, gradients: Models, optimisers: tuple[optax.OptState, ...]
) -> tuple[Models, tuple[optax.OptState, ...]]:
    """One Adam step per model, each with its own gradient clip [D6]."""
    every = zip(Models._fields, models, gradients, optimisers, strict=True)
    stepped, states = zip(*(step_one(config, *one) for one in every), strict=True)
    return Models(*stepped), tuple(states)


def step_one(
    config: Fitting, name: str, model: Any, gradient: Any, optimiser: optax.OptState
) -> tuple[Any, optax.OptState]:
    """The step of the model of that name."""
    change, optimiser = _adam(config, name).update(trainable(gradient), optimiser)
    return eqx.apply_updates(model, change), optimiser


def trainable(models: Any) -> Any:
    """The floating-point arrays of one or all models, None in place of the rest."""
    return eqx.filter(models, eqx.is_inexact_array)


def _adam(config: Fitting, name: str) -> optax.GradientTransformation:
    per_epoch = config.num_updates * (config.dynamics_updates if name == "dynamics" else 1)
    first, halving = config.learning_rate, config.rate_halving * per_epoch
    rate = partial(_falling, first, halving) if halving < math.inf else first
    return optax.chain(_clipped(config.gradient_clip), optax.adam(rate))


def _clipped(longest: float) -> optax.GradientTransformation:
    """Shortens the gradient of each model on its own, also of each of several policies [D6]."""
    clip = optax.clip_by_global_norm(longest)

    def update(updates: Any, state: Any, params: Any = None) -> tuple[Any, Any]:
        if not isinstance(updates, tuple):
            return clip.update(updates, state, params)
        return tuple(clip.update(each, state)[0] for each in updates), state

    return optax.GradientTransformation(clip.init, update)


def _falling(first: float, halving: float, step: ArrayLike) -> Float[Array, ""]:
    """A step size that has halved after `halving` steps, and goes on falling [D35]."""
    return first / (1 + jnp.asarray(step, jnp.float32) / halving)
