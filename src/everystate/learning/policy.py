"""Safe policy improvement: `Update_Value_Function_and_Policy` up to v_targ (4.3, Algorithm 1)."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from flowjax.distributions import AbstractTransformed
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning.flows import ConditionalFlow, FlowJAXConditionalFlow, decode
from everystate.learning.rewards import closeness, place
from everystate.learning.value import backup


class Policy(eqx.Module):
    """pi(a|s, g): a conditional flow of both."""

    flow: ConditionalFlow | FlowJAXConditionalFlow
    relative: bool = eqx.field(static=True)
    """Sees g - s in the place of g [D20]."""

    def __call__(self, state: Float[Array, " s"], goal: Float[Array, " s"]) -> AbstractTransformed:
        """The distribution of actions for one state and one goal, both scaled."""
        return self.flow(jnp.concatenate([state, goal - state if self.relative else goal]))


class Improvement(NamedTuple):
    """The best candidate and what it is worth."""

    action: Float[Array, " a"]
    """a_best, in [-1, 1]."""
    value: Float[Array, ""]
    """v_targ: mean of r + V_targ over the N rollouts of a_best."""
    from_policy: Float[Array, ""]
    """1 where a_best started from a policy sample rather than a random action."""
    off_support: Float[Array, ""]
    """Largest |component| of the imagined next states, in scaled units."""


def score(config: Config, returns: Float[Array, "*candidates N"]) -> Float[Array, "*candidates"]:
    """One number per candidate: the n-th percentile of its N returns, 0 the min, or the mean.

    The paper takes the min and suggests the percentile (4.3); the mean is its ablation (5.1).
    """
    if config.pessimism == "mean":
        return returns.mean(axis=-1)
    if config.percentile == 0:
        return returns.min(axis=-1)
    return jnp.percentile(returns, config.percentile, axis=-1)


def improve(
    config: Config,
    models: Any,
    target_value: Callable,
    state: Float[Array, " s"],
    goal: Float[Array, " s"],
    floor: Float[Array, ""],
    *,
    key: PRNGKeyArray,
) -> Improvement:
    """argmax over candidates of the worst of N imagined outcomes (eq. 3), for one (s, g).

    Candidates are j policy samples and j random actions, each also moved along its gradient of
    r + V_targ. Actions are clipped to [-1, 1]. All candidates share the N noises.

    Args:
        config: hyper-parameters j, N, k, pessimism, ...
        models: anything with `state_flow`, `dynamics` and `policy`, as in `Models`.
        target_value: V_targ(s, g).
        state: s, scaled.
        goal: g, scaled.
        floor: lowest value that V_targ can have [D4].
        key: random key.
    """
    key_policy, key_random, key_step, key_rollouts, key_sensor = jax.random.split(key, 5)
    place_goal = place(config, models.state_flow, goal)

    def imagined(
        dynamics: AbstractTransformed, latent: Float[Array, " s"], noise: Float[Array, " s"]
    ) -> tuple[Float[Array, ""], Float[Array, " s"]]:
        next_state = decode(dynamics, latent) + noise
        near = closeness(config, place(config, models.state_flow, next_state), place_goal)
        return backup(config, near, target_value(next_state, goal), floor), next_state

    def outcome(action: Float[Array, " a"], latent: Float[Array, " s"]) -> Float[Array, ""]:
        return imagined(models.dynamics(state, action), latent, jnp.zeros_like(state))[0]

    policy = models.policy(state, goal)
    latents = jax.random.normal(key_policy, (config.j, *policy.shape))
    from_policy = jnp.clip(jax.vmap(lambda z: decode(policy, z))(latents), -1, 1)
    at_random = jax.random.uniform(key_random, from_policy.shape, minval=-1, maxval=1)
    started = jnp.concatenate([from_policy, at_random])
    step_latents = jax.random.normal(key_step, (2 * config.j, state.size))
    gradients = jax.vmap(jax.grad(outcome))(started, step_latents)
    limit = config.max_gradient_step
    steps = jnp.clip(config.gradient_step * gradients, -limit, limit)
    candidates = jnp.concatenate([started, jnp.clip(started + steps, -1, 1)])

    rollouts = jax.random.normal(key_rollouts, (config.N, state.size))
    sensor = config.sensor_noise * jax.random.normal(key_sensor, (config.N, state.size))

    def returns(action: Float[Array, " a"]) -> tuple[Float[Array, " N"], Float[Array, "N s"]]:
        dynamics = models.dynamics(state, action)
        return jax.vmap(lambda z, e: imagined(dynamics, z, e))(rollouts, sensor)

    outcomes, next_states = jax.vmap(returns)(candidates)
    best = jnp.argmax(score(config, outcomes))
    is_policy = (best % (2 * config.j)) < config.j
    return Improvement(
        candidates[best],
        outcomes[best].mean(),
        is_policy.astype(state.dtype),
        jnp.abs(next_states).max(),
    )
