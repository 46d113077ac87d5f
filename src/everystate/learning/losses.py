"""What each model is trained on: the likelihoods and the squared error of Algorithm 1."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning.curriculum import curriculum_weights
from everystate.learning.dynamics import Dynamics
from everystate.learning.flows import decode
from everystate.learning.imagination import imagined_returns
from everystate.learning.keys import named
from everystate.learning.models import Models, trainable
from everystate.learning.networks import Value
from everystate.learning.policy import Improvement
from everystate.learning.replay import Minibatch, Transitions


def gradients(
    config: Config,
    models: Models,
    minibatch: Minibatch,
    starts: Float[Array, "batch s"],
    improvement: Improvement,
    target_value: Value,
    floor: Float[Array, ""],
    *,
    key: PRNGKeyArray,
) -> tuple[Models, dict[str, Float[Array, ""]]]:
    """Gradients of every model's loss on one minibatch, and the losses.

    Each loss reaches only its own model, so the gradient of their sum is all five at once.

    Args:
        config: hyper-parameters.
        models: f, d, pi, c, V.
        minibatch: from the replay buffers.
        starts: s_i, some replaced by the curriculum.
        improvement: a_best and v_targ for each (s_i, g_i).
        target_value: V_targ(s, g).
        floor: lowest value that V_targ can have [D4].
        key: for the noise floors [D3], and for what is imagined [D25].
    """
    goals = minibatch.goals

    def noisy(x: Float[Array, "batch n"], name: str, sd: float) -> Float[Array, "batch n"]:
        return x + sd * jax.random.normal(named(key, name), x.shape)

    def total(new: Models) -> tuple[Float[Array, ""], dict[str, Float[Array, ""]]]:
        new = eqx.combine(new, models)
        parts = {
            "f": -new.state_flow.log_prob(noisy(minibatch.states, "f", config.state_noise)).mean(),
            "d": dynamics_loss(config, new.dynamics, minibatch.transitions, key=named(key, "d")),
            "pi": policy_loss(new, starts, goals, noisy(improvement.action, "pi", sd=action_sd)),
            "c": curriculum_loss(new, goals, noisy(starts, "c", config.state_noise), weights),
        }
        targets = improvement.value
        if config.imagined_weight or config.imagined_targets:
            imagined = imagined_returns(
                config,
                models,
                new.policy,
                target_value,
                floor,
                starts,
                goals,
                key=named(key, "imagined"),
            )
            parts["imagined"] = -config.imagined_weight * imagined.climbed.mean()
            counted = jax.lax.stop_gradient(imagined.counted)
            targets += config.imagined_targets * (counted - targets)
        parts["V"] = value_loss(config, new, starts, goals, targets)
        if config.hindsight:
            t = minibatch.transitions
            parts["hindsight"] = policy_loss(
                new,
                t.observations,
                minibatch.hindsight_goals,
                noisy(t.actions, "hindsight", sd=action_sd),
            )
        return jnp.stack(list(parts.values())).sum(), parts

    action_sd = config.action_noise
    errors = (jax.vmap(models.value)(starts, goals) - improvement.value) ** 2
    weights = curriculum_weights(config, errors, improvement.value)
    (_, parts), gradient = jax.value_and_grad(total, has_aux=True)(trainable(models))
    return gradient, parts


def dynamics_loss(
    config: Config, dynamics: Dynamics, t: Transitions, *, key: PRNGKeyArray
) -> Float[Array, ""]:
    """Minus the mean log d(s'|s, a), with noise of `dynamics_noise` sds of the change on s'.

    And the squared error of its centre, in those sds [D28].
    """
    noise = config.dynamics_noise * jax.random.normal(key, t.observations.shape)
    scale = jax.lax.stop_gradient(dynamics.change_scale)
    reached = t.next_observations + noise * jnp.broadcast_to(scale, noise.shape)

    def of_one(s: Array, a: Array, s_next: Array) -> Float[Array, ""]:
        outcomes = dynamics(s, a)
        loss = -outcomes.log_prob(s_next)
        if config.centre_weight:
            error = (decode(outcomes, jnp.zeros_like(s)) - s_next) / scale
            loss += config.centre_weight * jnp.sum(error**2)
        return loss

    return jax.vmap(of_one)(t.observations, t.actions, reached).mean()


def policy_loss(
    models: Models,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    actions: Float[Array, "batch a"],
) -> Float[Array, ""]:
    """Minus the mean log pi(a|s, g)."""

    def log_prob(s: Array, g: Array, a: Array) -> Float[Array, ""]:
        return models.policy(s, g).log_prob(a)

    return -jax.vmap(log_prob)(states, goals, actions).mean()


def curriculum_loss(
    models: Models,
    goals: Float[Array, "batch s"],
    states: Float[Array, "batch s"],
    weights: Float[Array, " batch"],
) -> Float[Array, ""]:
    """Minus the weighted sum of log c(s|g)."""
    log_prob = jax.vmap(lambda g, s: models.curriculum(g).log_prob(s))
    return -jnp.sum(weights * log_prob(goals, states))


def value_loss(
    config: Config,
    models: Models,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    targets: Float[Array, " batch"],
) -> Float[Array, ""]:
    """Mean of (V(s, g) - v_targ)^2 + V(g, g)^2 (Algorithm 1), the former also per unit [D29]."""
    errors = (jax.vmap(models.value)(states, goals) - targets) ** 2
    if config.relative_errors:
        errors /= 1 + jnp.abs(targets)
    at_goals = jax.vmap(models.value)(goals, goals)
    return jnp.mean(errors) + config.goal_value_weight * jnp.mean(at_goals**2)
