"""Planning at act time through the learned dynamics and value (4.2), a few steps ahead."""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from everystate.config import Config
from everystate.errors import EverystateError
from everystate.learning.flows import decode
from everystate.learning.models import Models
from everystate.learning.objectives import Objective, objectives, pursued
from everystate.learning.policy import score
from everystate.learning.ways import rolled

_LEAST_SPREAD = 0.05  # of refined actions, so that equal elites do not end the search


@dataclass(frozen=True)
class Planning:
    """How much thought an action is worth; `horizon=1, rounds=1` is one step of lookahead."""

    horizon: int = 8
    """Steps looked ahead; V judges where they end."""
    candidates: int = 32
    """Sequences of actions per round."""
    rounds: int = 2
    """Of the cross-entropy method: each draws around the best sequences of the one before."""
    elites: int = 8
    """How many those are."""
    rollouts: int = 4
    """Imagined outcomes per sequence, of which the worst counts, as in training."""

    def __post_init__(self) -> None:
        for name, least in (("horizon", 1), ("candidates", 2), ("rounds", 1), ("rollouts", 1)):
            value = getattr(self, name)
            if not (isinstance(value, int) and least <= value <= 10_000):
                raise EverystateError(f"planning {name} is {value!r}: choose {least} to 10000")
        if not 1 <= self.elites < self.candidates:
            raise EverystateError(
                f"planning elites is {self.elites}: choose 1 to {self.candidates - 1}, fewer than"
                " candidates"
            )


def plan(
    config: Config,
    planning: Planning,
    models: Models,
    state: Float[Array, " s"],
    goal: Float[Array, " s"],
    *,
    key: PRNGKeyArray,
) -> Float[Array, "horizon a"]:
    """The best sequence of actions found, for one scaled (s, g).

    Half of the first round's sequences follow the policy through the learned dynamics, one of them
    at z = 0; half are uniformly random. Later rounds refine them by the cross-entropy method
    (Rubinstein 1999). A sequence is worth the worst of its imagined returns (eq. 3): the rewards
    on the way and V at its end. Reaching ends no count here [D10]: once at the goal one stays, if
    one can. All sequences share the same noises. Of several objectives that counts by which the
    goal is pursued [D31].
    """
    every = zip(objectives(config), models.policies, models.values, strict=True)
    found = [_search(config, planning, models, *one, state, goal, key) for one in every]
    return jnp.stack(found)[pursued(config, models, state, goal)]


def _search(
    config: Config,
    planning: Planning,
    models: Models,
    aim: Objective,
    policy: Callable,
    value: Callable,
    state: Float[Array, " s"],
    goal: Float[Array, " s"],
    key: PRNGKeyArray,
) -> Float[Array, "horizon a"]:
    key_noise, key_policy, key_random, *keys = jax.random.split(key, 2 + planning.rounds)
    noises = jax.random.normal(key_noise, (planning.rollouts, planning.horizon, state.size))

    def follow(latents: Float[Array, "horizon a"]) -> Float[Array, "horizon a"]:
        """What the policy would do where the dynamics, without noise, say that it leads."""

        def one(s: Array, latent: Array) -> tuple[Array, Array]:
            action = jnp.clip(decode(policy(s, goal), latent), -1, 1)
            return models.dynamics.central(s, action), action

        return jax.lax.scan(one, state, latents)[1]

    def worth(actions: Float[Array, "horizon a"]) -> Float[Array, ""]:
        def outcome(noise: Float[Array, "horizon s"]) -> Float[Array, ""]:
            def act(step: Int[Array, ""], _: Array) -> Float[Array, " a"]:
                return actions[step]

            way = rolled(config, models, value, aim, act, state, goal, noise)
            return aim.ahead(way.near, way.last)

        return score(config, jax.vmap(outcome)(noises))

    shape = policy(state, goal).shape
    half = planning.candidates // 2
    latents = jax.random.normal(key_policy, (half, planning.horizon, *shape)).at[0].set(0.0)
    wild_shape = (planning.candidates - half, planning.horizon, *shape)
    wild = jax.random.uniform(key_random, wild_shape, minval=-1, maxval=1)
    sequences = jnp.concatenate([jax.vmap(follow)(latents), wild])
    values = jax.vmap(worth)(sequences)
    for key_round in keys:
        order = jnp.argsort(-values)[: planning.elites]
        best = sequences[order]
        fresh = planning.candidates - planning.elites
        noise = jax.random.normal(key_round, (fresh, *best.shape[1:]))
        spread = jnp.maximum(best.std(axis=0), _LEAST_SPREAD)
        around = jnp.clip(best.mean(axis=0)[None] + spread[None] * noise, -1, 1)
        sequences = jnp.concatenate([best, around])
        values = jnp.concatenate([values[order], jax.vmap(worth)(around)])
    return sequences[jnp.argmax(values)]
