"""What each model is trained on: the likelihoods and the squared error of Algorithm 1."""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning.components import unit
from everystate.learning.curriculum import curriculum_weights
from everystate.learning.dynamics import Dynamics
from everystate.learning.imagination import Way, climbed, counted, imagined, way_of
from everystate.learning.keys import named
from everystate.learning.models import Models, trainable
from everystate.learning.networks import Value
from everystate.learning.objectives import Objective, readings
from everystate.learning.policy import Improvement, Policy
from everystate.learning.replay import Minibatch, Transitions

_STILL = 0.1
"""Of a change, in its sds: below this nothing counts for more in d's error [D37]."""

_NEAREST = 0.1
"""In units of action: nearer to a_best the slope to it is mostly noise [D40]."""


def gradients(
    config: Config,
    models: Models,
    imagines: Dynamics,
    minibatch: Minibatch,
    starts: Float[Array, "batch s"],
    improvements: Sequence[Improvement],
    target_values: Sequence[Value],
    aims: Sequence[Objective],
    *,
    key: PRNGKeyArray,
) -> tuple[Models, dict[str, Float[Array, ""]]]:
    """Gradients of every model's loss on one minibatch, and the losses.

    Each loss reaches only its own model, so the gradient of their sum is all of them at once.

    Args:
        config: hyper-parameters.
        models: f, d, pi, c, V.
        imagines: the d that imagines [D35].
        minibatch: from the replay buffers.
        starts: s_i, some replaced by the curriculum.
        improvements: a_best and v_targ for the first of the (s_i, g_i), or for all; by objective.
        target_values: V_targ(s, g), of each V.
        aims: the objectives.
        key: for the noise floors [D3], and for what is imagined [D25].
    """
    goals, some = minibatch.goals, slice(len(improvements[0].action))

    def noisy(x: Float[Array, "batch n"], name: str, sd: float) -> Float[Array, "batch n"]:
        return x + sd * jax.random.normal(named(key, name), x.shape)

    def way(policy: Policy, number: int) -> Way:
        """How it goes by the d that imagines."""
        return way_of(
            config, by_d, policy.central, target_values[number], aims[number], len(starts)
        )

    def of_objective(new: Models, number: int) -> dict[str, Float[Array, ""]]:
        """What pi of one objective is trained on."""
        aim, improvement, policy = aims[number], improvements[number], new.policies[number]
        actions = noisy(improvement.action, f"pi{aim.suffix}", sd=config.action_noise)
        parts = {"pi": policy_loss(policy, starts[some], goals[some], actions)}
        if ways:
            latents, _ = ways[number]
            returns = climbed(aim, way(policy, number), starts, goals, latents)
            better = better_loss(policy, starts[some], goals[some], improvement)
            parts["imagined"] = -config.imagined_weight * returns.mean()
            parts["better"] = config.imagined_weight * better / len(starts)
        if config.hindsight:
            t = minibatch.transitions
            actions = noisy(t.actions, f"hindsight{aim.suffix}", sd=config.action_noise)
            parts["hindsight"] = policy_loss(policy, t.observations, t.next_observations, actions)
        return {f"{name}{aim.suffix}": loss for name, loss in parts.items()}

    def of_reading(new: Models, number: int) -> Float[Array, ""]:
        """What one V is trained on: at s, or all along a way from there [D42]."""
        (of, aim, _), value = told[number], new.values[number]
        if not ways:
            return value_loss(config, aim, value, starts, goals, improvements[number].value)
        known = config, by_d, target_values[number], aim
        along, targets = counted(*known, ways[of].states, goals)
        if number < len(aims):
            targets = targets.at[some, 0].set(improvements[number].value)
        towards = jnp.repeat(goals, targets.shape[1], axis=0)
        along = along.reshape(towards.shape)
        return value_loss(config, aim, value, along, towards, targets.reshape(-1))

    def total(new: Models) -> tuple[Float[Array, ""], dict[str, Float[Array, ""]]]:
        new = eqx.combine(new, models)
        parts = {
            "f": -new.state_flow.log_prob(noisy(minibatch.states, "f", config.state_noise)).mean(),
            "d": dynamics_loss(config, new.dynamics, minibatch.transitions, key=named(key, "d")),
            "c": curriculum_loss(
                new, goals[some], noisy(starts[some], "c", config.state_noise), weights
            ),
        }
        for number in range(len(aims)):
            parts |= of_objective(new, number)
        parts |= {f"V{one.suffix}": of_reading(new, i) for i, one in enumerate(told)}
        return jnp.stack(list(parts.values())).sum(), parts

    told, by_d = readings(aims), models._replace(dynamics=imagines)
    ways = [
        imagined(
            config,
            aim,
            way(models.policies[number], number),
            starts,
            goals,
            key=named(key, f"imagined{aim.suffix}"),
        )
        for number, aim in enumerate(aims)
        if config.imagined_steps
    ]
    wanted = improvements[0].value
    errors = (values(models.values[0], starts[some], goals[some]) - wanted) ** 2
    weights = curriculum_weights(config, errors, wanted)
    (_, parts), gradient = jax.value_and_grad(total, has_aux=True)(trainable(models))
    return gradient, parts


def dynamics_loss(
    config: Config, dynamics: Dynamics, t: Transitions, *, key: PRNGKeyArray
) -> Float[Array, ""]:
    """Minus the mean log d(s'|s, a), with noise of `dynamics_noise` sds of the change on s'.

    And the squared error of its centre, in those sds [D28]. If that is a network of its own [D36],
    it counts by how much changes, and is that of s' without noise: where a body is all but still,
    as near a goal that it holds, an error of a hundredth has the policy lean against it [D37].
    """
    noise = config.dynamics_noise * jax.random.normal(key, t.observations.shape)
    reached = t.next_observations + noise * jnp.broadcast_to(dynamics.scale, noise.shape)

    def of_one(s: Array, a: Array, s_next: Array, s_noisy: Array) -> Float[Array, ""]:
        loss = -dynamics.fitted(s, a).log_prob(s_noisy)
        if not config.centre_weight:
            return loss
        centre = dynamics.central(s, a)
        if not config.centres:
            return loss + config.centre_weight * _square(centre - s_noisy)
        change = jax.lax.stop_gradient(centre - s)
        weight = config.centre_weight / (_STILL**2 + jnp.mean((change / of_step) ** 2))
        return loss + weight * _square(centre - s_next)

    def _square(apart: Float[Array, " s"]) -> Float[Array, ""]:
        return jnp.sum((apart / dynamics.scale) ** 2)

    of_step = unit(dynamics)

    return jax.vmap(of_one)(t.observations, t.actions, t.next_observations, reached).mean()


def policy_loss(
    policy: Policy,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    actions: Float[Array, "batch a"],
) -> Float[Array, ""]:
    """Minus the mean log pi(a|s, g)."""

    def log_prob(s: Array, g: Array, a: Array) -> Float[Array, ""]:
        return policy.fitted(s, g).log_prob(a)

    return -jax.vmap(log_prob)(states, goals, actions).mean()


def better_loss(
    policy: Policy,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    improvement: Improvement,
) -> Float[Array, ""]:
    """What leads the policy's centre to a_best, as steeply as that gains on the way [D40].

    Its gradient is the slope between the two, summed over the pairs.
    """
    square = jnp.sum((jax.vmap(policy.central)(states, goals) - improvement.action) ** 2, axis=1)
    least = jnp.maximum(jax.lax.stop_gradient(square), _NEAREST**2)
    return jnp.sum(improvement.gain * square / (2 * least))


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
    value: Callable, states: Float[Array, "n s"], goals: Float[Array, "n s"]
) -> Float[Array, " n"]:
    """V's outputs."""
    return jax.vmap(value)(states, goals)


def value_loss(
    config: Config,
    aim: Objective,
    value: Callable,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    targets: Float[Array, " batch"],
) -> Float[Array, ""]:
    """Mean of (V(s, g) - v_targ)^2 + V(g, g)^2 (Algorithm 1), or what `aim` has in its place."""
    loss = jnp.mean(aim.errors(values(value, states, goals), targets))
    if config.goal_value_weight:
        loss += config.goal_value_weight * jnp.mean(values(value, goals, goals) ** 2)
    return loss
