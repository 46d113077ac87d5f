"""What each model is trained on: the likelihoods and the squared error of Algorithm 1."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning.curriculum import curriculum_weights
from everystate.learning.dynamics import Dynamics
from everystate.learning.imagination import imagined_returns
from everystate.learning.keys import named
from everystate.learning.models import Models, trainable
from everystate.learning.networks import Value
from everystate.learning.objectives import Objective
from everystate.learning.policy import Improvement
from everystate.learning.replay import Minibatch, Transitions


def gradients(
    config: Config,
    models: Models,
    imagines: Dynamics,
    minibatch: Minibatch,
    starts: Float[Array, "batch s"],
    improvement: Improvement,
    target_value: Value,
    aim: Objective,
    *,
    key: PRNGKeyArray,
) -> tuple[Models, dict[str, Float[Array, ""]]]:
    """Gradients of every model's loss on one minibatch, and the losses.

    Each loss reaches only its own model, so the gradient of their sum is all five at once.

    Args:
        config: hyper-parameters.
        models: f, d, pi, c, V.
        imagines: the d that imagines [D35].
        minibatch: from the replay buffers.
        starts: s_i, some replaced by the curriculum.
        improvement: a_best and v_targ for the first of the (s_i, g_i), or for all.
        target_value: V_targ(s, g).
        aim: what V counts.
        key: for the noise floors [D3], and for what is imagined [D25].
    """
    goals, some = minibatch.goals, slice(len(improvement.action))

    def noisy(x: Float[Array, "batch n"], name: str, sd: float) -> Float[Array, "batch n"]:
        return x + sd * jax.random.normal(named(key, name), x.shape)

    def total(new: Models) -> tuple[Float[Array, ""], dict[str, Float[Array, ""]]]:
        new = eqx.combine(new, models)
        parts = {
            "f": -new.state_flow.log_prob(noisy(minibatch.states, "f", config.state_noise)).mean(),
            "d": dynamics_loss(config, new.dynamics, minibatch.transitions, key=named(key, "d")),
            "pi": policy_loss(
                new, starts[some], goals[some], noisy(improvement.action, "pi", sd=action_sd)
            ),
            "c": curriculum_loss(
                new, goals[some], noisy(starts[some], "c", config.state_noise), weights
            ),
        }
        targets = improvement.heads
        if config.imagined_weight or config.imagined_targets:
            imagined = imagined_returns(
                config,
                models._replace(dynamics=imagines),
                new.policy.central,
                target_value,
                aim,
                starts,
                goals,
                key=named(key, "imagined"),
            )
            parts["imagined"] = -config.imagined_weight * imagined.climbed.mean()
            counted = jax.lax.stop_gradient(imagined.counted)
            if config.imagined_targets == 1:
                targets = counted
            else:
                targets += config.imagined_targets * (counted - targets)
        parts["V"] = value_loss(config, aim, new, starts, goals, targets)
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
    worth = jax.vmap(aim.worth)
    wanted = worth(improvement.heads)
    errors = (worth(jax.vmap(aim.read)(values(models, starts[some], goals[some]))) - wanted) ** 2
    weights = curriculum_weights(config, errors, wanted)
    (_, parts), gradient = jax.value_and_grad(total, has_aux=True)(trainable(models))
    return gradient, parts


def dynamics_loss(
    config: Config, dynamics: Dynamics, t: Transitions, *, key: PRNGKeyArray
) -> Float[Array, ""]:
    """Minus the mean log d(s'|s, a), with noise of `dynamics_noise` sds of the change on s'.

    And the squared error of its centre, in those sds [D28], [D36].
    """
    noise = config.dynamics_noise * jax.random.normal(key, t.observations.shape)
    reached = t.next_observations + noise * jnp.broadcast_to(dynamics.scale, noise.shape)

    def of_one(s: Array, a: Array, s_next: Array) -> Float[Array, ""]:
        loss = -dynamics.fitted(s, a).log_prob(s_next)
        if config.centre_weight:
            error = (dynamics.central(s, a) - s_next) / dynamics.scale
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
        return models.policy.fitted(s, g).log_prob(a)

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


def values(
    models: Models, states: Float[Array, "n s"], goals: Float[Array, "n s"]
) -> Float[Array, "n heads"]:
    """V's outputs."""
    return jax.vmap(models.value)(states, goals)


def value_loss(
    config: Config,
    aim: Objective,
    models: Models,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    targets: Float[Array, "batch heads"],
) -> Float[Array, ""]:
    """Mean of (V(s, g) - v_targ)^2 + V(g, g)^2 (Algorithm 1), or what `aim` has in its place."""
    loss = jnp.mean(aim.errors(values(models, states, goals), targets))
    if config.goal_value_weight:
        loss += config.goal_value_weight * jnp.mean(values(models, goals, goals) ** 2)
    return loss
