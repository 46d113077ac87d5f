"""Planning at act time through the learned dynamics and value (4.2), a few steps ahead."""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning.flows import decode
from everystate.learning.policy import score
from everystate.learning.rewards import closeness, place
from everystate.learning.value import backup


@dataclass(frozen=True)
class Planning:
    """How much thought an action is worth."""

    horizon: int = 5
    """Steps looked ahead; V judges where they end."""
    candidates: int = 64
    """Sequences of actions per round."""
    rounds: int = 3
    """Of the cross-entropy method: each draws around the best sequences of the one before."""
    elites: int = 8
    rollouts: int = 4
    """Imagined outcomes per sequence, of which the worst counts, as in training."""


def plan(
    config: Config,
    planning: Planning,
    models: Any,
    state: Float[Array, " s"],
    goal: Float[Array, " s"],
    *,
    key: PRNGKeyArray,
) -> Float[Array, " a"]:
    """The first action of the best sequence found, for one scaled (s, g).

    Half of the first round's sequences follow the policy, half are uniformly random; later rounds
    refine them by the cross-entropy method. Returns are those of eq. 2 along the way, V at the end.
    """
    keys = jax.random.split(key, planning.rounds + 2)
    place_goal = place(config, models.state_flow, goal)
    size = models.policy(jnp.concatenate([state, goal])).shape
    half = planning.candidates // 2
    noises = jax.random.normal(keys[0], (planning.rollouts, planning.horizon, state.size))

    def follow(latents: Float[Array, "h a"]) -> Float[Array, "h a"]:
        def one(s: Array, z: Array) -> tuple[Array, Array]:
            action = jnp.clip(decode(models.policy(jnp.concatenate([s, goal])), z), -1, 1)
            return decode(models.dynamics(s, action), jnp.zeros_like(s)), action

        return jax.lax.scan(one, state, latents)[1]

    def value_of(actions: Float[Array, "h a"]) -> Float[Array, ""]:
        def outcome(noise: Float[Array, "h s"]) -> Float[Array, ""]:
            def one(s: Array, x: tuple[Array, Array]) -> tuple[Array, Array]:
                action, z = x
                after = decode(models.dynamics(s, action), z)
                return after, closeness(config, place(config, models.state_flow, after), place_goal)

            last, near = jax.lax.scan(one, state, (actions, noise))
            floor = jnp.float32(-jnp.inf)
            total = models.value(last, goal)
            for step in reversed(range(planning.horizon)):
                total = backup(config, near[step], total, floor)
            return total

        return score(config, jax.vmap(outcome)(noises))

    latents = jax.random.normal(keys[1], (half, planning.horizon, *size))
    latents = latents.at[0].set(0.0)  # the policy's most central way
    following = jax.vmap(follow)(latents)
    wild = jax.random.uniform(keys[2], following.shape, minval=-1, maxval=1)
    sequences = jnp.concatenate([following, wild])
    values = jax.vmap(value_of)(sequences)
    for round_key in keys[3:]:
        best = sequences[jnp.argsort(-values)[: planning.elites]]
        spread = jnp.maximum(best.std(axis=0), 0.05)
        noise = jax.random.normal(
            round_key, (planning.candidates - planning.elites, *best.shape[1:])
        )
        fresh = jnp.clip(best.mean(axis=0) + spread * noise, -1, 1)
        sequences = jnp.concatenate([best, fresh])
        values = jax.vmap(value_of)(sequences)
    return sequences[jnp.argmax(values), 0]
