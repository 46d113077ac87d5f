"""Safe policy improvement by ways of several steps instead of one [D40].

The rollout algorithm (Bertsekas and Tsitsiklis 1996): what an action is worth is what comes of it
if it is kept for a while, and the policy goes on from there.
"""

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from everystate.config import Config
from everystate.learning.imagination import within
from everystate.learning.objectives import Objective
from everystate.learning.policy import Improvement, Policy, score
from everystate.learning.ways import nearness, rolled


def improve_by_rollouts(
    config: Config,
    models: Any,
    policy: Policy,
    target_value: Callable,
    aim: Objective,
    states: Float[Array, "batch s"],
    goals: Float[Array, "batch s"],
    *,
    key: PRNGKeyArray,
) -> Improvement:
    """argmax over candidates of the worst of N ways (eq. 3), for every (s, g).

    Candidates are j policy samples and j random actions, each kept for 1 to `kept_steps` steps,
    after which the centre of the policy acts; and that centre from the beginning. All share the
    noises of their N ways; what the best is worth, and gains, is told by N others, as it would be
    overrated by those that chose it. See `policy.improve` for the arguments.
    """

    def of_one(s: Array, g: Array, key: PRNGKeyArray) -> Improvement:
        key_policy, key_random, key_kept, key_ways = jax.random.split(key, 4)
        own: Any = within(policy.central(s, g))
        drawn = jax.random.normal(key_policy, (config.j, *own.shape))
        sampled = jnp.clip(jax.vmap(lambda z: policy.at(s, g, z))(drawn), -1, 1)
        at_random = jax.random.uniform(key_random, sampled.shape, minval=-1, maxval=1)
        actions = jnp.concatenate([own[None], sampled, at_random])
        longest = math.log2(config.kept_steps + 1)
        kept = 2.0 ** jax.random.uniform(key_kept, (len(actions),), maxval=longest)
        kept = kept.astype(jnp.int32).at[0].set(0)
        latents = jax.random.normal(key_ways, (2, config.N, config.imagined_steps, s.size))

        def returns(action: Float[Array, " a"], kept: Int[Array, ""], latents: Array) -> Any:
            def act(step: Array, s: Array) -> Array:
                return jnp.where(step < kept, action, within(policy.central(s, g)))

            way = rolled(models, act, s, latents)
            near, last = nearness(config, models, aim, way, g), target_value(way[-1], g)
            counted = aim.counted(near, aim.read(last))[0]
            return aim.climbed(near, aim.read(last)), counted, jnp.abs(way).max()

        every = jax.vmap(jax.vmap(returns, (None, None, 0)), (0, 0, None))
        best = score(config, every(actions, kept, latents[0])[0]).argmax()
        two = jnp.stack([jnp.zeros((), best.dtype), best])
        climbed, counted, furthest = every(actions[two], kept[two], latents[1])
        own, other = score(config, climbed)
        return Improvement(
            action=actions[best],
            value=counted[1].mean(),
            from_policy=(best <= config.j).astype(jnp.float32),
            off_support=furthest.max(),
            evaluated=jnp.ones(()),
            gain=jnp.maximum(other - own, 0),
        )

    keys = jax.random.split(key, len(states))
    return jax.vmap(of_one)(states, goals, keys)
