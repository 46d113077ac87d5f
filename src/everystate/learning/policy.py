"""Safe policy improvement: `Update_Value_Function_and_Policy` up to v_targ (4.3, Algorithm 1)."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from flowjax.distributions import AbstractTransformed
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from everystate.config import Config
from everystate.hyperparameters import PolicyImprovement, Returns
from everystate.learning.conditional import Centred, Conditional
from everystate.learning.facing import Horizontal
from everystate.learning.flows import decode
from everystate.learning.networks import with_goal
from everystate.learning.objectives import Objective, pursued
from everystate.learning.rewards import placing
from everystate.learning.search import best_worst_case, blocked
from everystate.learning.sharding import on_each_device


class Policy(eqx.Module):
    """pi(a|s, g): a conditional flow of both."""

    flow: Conditional
    both: bool = eqx.field(static=True)
    """Whether it sees g - s beside s and g [D20]."""
    horizontal: Horizontal = eqx.field(static=True)

    def __call__(self, state: Float[Array, " s"], goal: Float[Array, " s"]) -> AbstractTransformed:
        """The distribution of actions for one state and one goal, both scaled."""
        return self.flow(self._seen(state, goal))

    def at(
        self, state: Float[Array, " s"], goal: Float[Array, " s"], latent: Float[Array, " a"]
    ) -> Float[Array, " a"]:
        """The action of a latent z, which may lie beyond the bounds; of z = 0 the most central."""
        sampled = decode(self(state, goal), latent)
        if not isinstance(self.flow, Centred):
            return sampled  # Its centre is that of z = 0.
        return jnp.where((latent == 0).all(), self.central(state, goal), sampled)

    def central(self, state: Float[Array, " s"], goal: Float[Array, " s"]) -> Float[Array, " a"]:
        """The most central action, which may lie beyond the bounds."""
        return self.flow.central(self._seen(state, goal))

    def fitted(self, state: Float[Array, " s"], goal: Float[Array, " s"]) -> AbstractTransformed:
        """The distribution of actions, as a likelihood may change it."""
        return self.flow.fitted(self._seen(state, goal))

    def _seen(self, state: Float[Array, " s"], goal: Float[Array, " s"]) -> Float[Array, " n"]:
        return with_goal(state, goal, self.both, self.horizontal)


def central(
    config: Returns, models: Any, state: Float[Array, " s"], goal: Float[Array, " s"]
) -> Float[Array, " a"]:
    """What an agent does: the most central action of the policy by which the goal is pursued.

    Args:
        config: hyper-parameters.
        models: as in `pursued`, and their `policies`.
        state: s, scaled.
        goal: g, scaled.
    """
    every = jnp.stack([policy.central(state, goal) for policy in models.policies])
    return jnp.clip(every[pursued(config, models, state, goal)], -1, 1)


class Improvement(NamedTuple):
    """The best candidate for each (s, g), and what it is worth."""

    action: Float[Array, "batch a"]
    """a_best, in [-1, 1]."""
    value: Float[Array, " batch"]
    """v_targ: mean of r + V_targ over the N rollouts of a_best."""
    from_policy: Float[Array, " batch"]
    """1 where a_best started from a policy sample rather than a random action."""
    off_support: Float[Array, " batch"]
    """Largest |component| of the imagined next states, in scaled units."""
    evaluated: Float[Array, " batch"]
    """Share of all returns that had to be evaluated to find a_best."""
    gain: Float[Array, " batch"]
    """How much more a_best is worth than the policy's centre [D40]; of the paper's, nothing."""


def described(
    aims: Sequence[Objective], improvements: Sequence[Improvement]
) -> dict[str, Float[Array, ""]]:
    """What is logged of them."""
    metrics: dict[str, Float[Array, ""]] = {}
    for aim, found in zip(aims, improvements, strict=True):
        targets = aim.worth(found.value)
        metrics |= {
            f"value/target{aim.suffix}": targets.mean(),
            f"value/target_min{aim.suffix}": targets.min(),
            f"policy/best_from_policy{aim.suffix}": found.from_policy.mean(),
            f"policy/evaluated{aim.suffix}": found.evaluated.mean(),
            f"policy/off_support{aim.suffix}": found.off_support.max(),
            f"policy/gain{aim.suffix}": found.gain.mean(),
        }
    return metrics


def score(
    config: PolicyImprovement, returns: Float[Array, "*candidates N"]
) -> Float[Array, "*candidates"]:
    """One number per candidate: the n-th percentile of its N returns, 0 the min, or the mean.

    The paper takes the min and suggests the percentile (4.3); the mean is its ablation (5.1).
    """
    if config.pessimism == "mean":
        return returns.mean(axis=-1)
    if config.percentile == 0:
        return returns.min(axis=-1)
    return jnp.percentile(returns, config.percentile, axis=-1)


def worst(config: PolicyImprovement, returns: Float[Array, " N"]) -> Int[Array, ""]:
    """Which of N returns counts, as in `score`; where that is the mean, any one stands for it."""
    if config.pessimism == "mean":
        return jnp.zeros((), jnp.int32)
    rank = round(config.percentile / 100 * (len(returns) - 1))
    return jnp.argsort(returns)[rank]


def improve(
    config: Config,
    models: Any,
    policy: Callable,
    target_value: Callable,
    aim: Objective,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    *,
    key: PRNGKeyArray,
) -> Improvement:
    """argmax over candidates of the worst of N imagined outcomes (eq. 3), for every (s, g).

    Args:
        config: hyper-parameters j, N, k, pessimism, ...
        models: anything with `state_flow` and `dynamics`, as in `Models`.
        policy: pi(a|s, g).
        target_value: V_targ(s, g).
        aim: what V counts.
        states: s, scaled.
        goals: g, scaled.
        key: random key.
    """
    keys = jax.random.split(key, states.shape[0])
    known = models, policy, target_value, aim
    return on_each_device(config, partial(_improve, config), known, states, goals, keys)


def _improve(
    config: Config,
    known: tuple[Any, Callable, Callable, Objective],
    states: Float[Array, "pairs s"],
    goals: Float[Array, "pairs s"],
    keys: Key[Array, " pairs"],
) -> Improvement:
    """`improve` of some of the (s, g), given the models, V_targ and what it counts."""
    models, policy, target_value, aim = known
    place = placing(config, models)

    def returns(next_state: Float[Array, " s"], goal: Float[Array, " s"]) -> Float[Array, ""]:
        """r + V_targ(s', g), without how near s is already, which is not the action's doing."""
        way = jnp.stack([jnp.zeros(()), aim.closeness(place(next_state), place(goal))])
        return aim.counted(way, aim.read(target_value(next_state, goal)))[0]

    def proposed(s: Array, g: Array, key: PRNGKeyArray) -> tuple[Array, Array]:
        return propose(config, models.dynamics, policy, returns, s, g, key=key)

    candidates, next_states = jax.vmap(proposed)(states, goals, keys)
    evaluate = blocked(returns)
    every = jnp.arange(states.shape[0], dtype=jnp.int32)
    if config.pessimism == "percentile" and config.percentile == 0:
        best, value, evaluated = best_worst_case(evaluate, next_states, goals)
    else:
        outcomes = evaluate(next_states.reshape(len(states), -1, states.shape[1]), goals)
        outcomes = outcomes.reshape(next_states.shape[:3])
        best = score(config, outcomes).argmax(axis=1)
        value, evaluated = outcomes[every, best].mean(axis=1), jnp.ones(len(states))
    is_policy = (best % (2 * config.j)) < config.j
    return Improvement(
        candidates[every, best],
        value,
        is_policy.astype(states.dtype),
        jnp.abs(next_states).max(axis=(1, 2, 3)),
        evaluated,
        jnp.zeros(len(states)),
    )


def propose(
    config: PolicyImprovement,
    dynamics: Callable,
    policy: Callable,
    returns: Callable,
    state: Float[Array, " s"],
    goal: Float[Array, " s"],
    *,
    key: PRNGKeyArray,
) -> tuple[Float[Array, "candidates a"], Float[Array, "candidates N s"]]:
    """Candidate actions for one (s, g), and N imagined next states of each.

    Candidates are j policy samples and j random actions, each also moved along its gradient of
    r + V_targ. Actions are clipped to [-1, 1]. All candidates share the N noises.
    """
    key_policy, key_random, key_step, key_rollouts, key_sensor = jax.random.split(key, 5)

    def outcome(action: Float[Array, " a"], latent: Float[Array, " s"]) -> Float[Array, ""]:
        return returns(decode(dynamics(state, action), latent), goal)

    actions = policy(state, goal)
    latents = jax.random.normal(key_policy, (config.j, *actions.shape))
    from_policy = jnp.clip(jax.vmap(lambda z: decode(actions, z))(latents), -1, 1)
    at_random = jax.random.uniform(key_random, from_policy.shape, minval=-1, maxval=1)
    started = jnp.concatenate([from_policy, at_random])
    step_latents = jax.random.normal(key_step, (2 * config.j, state.size))
    gradients = jax.vmap(jax.grad(outcome))(started, step_latents)
    limit = config.max_gradient_step
    moved = jnp.clip(started + jnp.clip(gradients, -limit, limit), -1, 1)
    candidates = jnp.concatenate([started, moved])

    rollouts = jax.random.normal(key_rollouts, (config.N, state.size))

    def imagined(action: Float[Array, " a"]) -> Float[Array, "N s"]:
        outcomes = dynamics(state, action)
        return jax.vmap(lambda z: decode(outcomes, z))(rollouts)

    next_states = jax.vmap(imagined)(candidates)
    if config.sensor_noise:
        sensor = config.sensor_noise * jax.random.normal(key_sensor, rollouts.shape)
        next_states += jnp.broadcast_to(sensor, next_states.shape)
    return candidates, next_states
