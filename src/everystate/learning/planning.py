"""Planning at act time through the learned dynamics and value (4.2): corrections of the policy."""

from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from everystate.config import Config
from everystate.errors import EverystateError
from everystate.learning.models import Models
from everystate.learning.objectives import objectives, pursued
from everystate.learning.policy import central, score
from everystate.learning.ways import nearness, rolled

_SURE = 2.0
"""Standard errors by which a mean gain must be above 0."""


@dataclass(frozen=True)
class Planning:
    """How much thought an action is worth."""

    horizon: int = 8
    """Steps looked ahead; V judges where they end."""
    rounds: int = 6
    """Steps of gradient ascent on the corrections of all actions on the way."""
    step: float = 0.2
    """How far the first of them moves an action."""
    rollouts: int = 4
    """Imagined outcomes that corrections are found on; the worst counts, as in training."""
    checks: int = 8
    """Others, on which they must do better than the policy alone."""

    def __post_init__(self) -> None:
        for name, least in (("horizon", 1), ("rounds", 1), ("rollouts", 1), ("checks", 2)):
            value = getattr(self, name)
            if not (isinstance(value, int) and least <= value <= 10_000):
                raise EverystateError(f"planning {name} is {value!r}: choose {least} to 10000")
        if not 0 < self.step <= 2:
            raise EverystateError(f"planning step is {self.step!r}: choose above 0 to 2")


class Planned(NamedTuple):
    """What a search decided for one (s, g)."""

    actions: Float[Array, "horizon a"]
    """On the way that the dynamics, without noise, say that they lead."""
    corrected: Bool[Array, ""]
    """Whether they are other than the policy's."""
    gain: Float[Array, ""]
    """By how much they seem better than the policy's, in steps, taken or not."""


def plan(
    config: Config,
    planning: Planning,
    models: Models,
    state: Float[Array, " s"],
    goal: Float[Array, " s"],
    *,
    key: PRNGKeyArray,
) -> Planned:
    """The policy's next actions, corrected where that is surely better, for one scaled (s, g).

    The policy acts all along a way of `horizon` steps, where the way itself leads it, and each
    action has a correction added. Corrections begin at 0 and climb the gradient of the worst of
    some imagined returns (eq. 3): the rewards on the way, and V at its end. Reaching ends no count
    [D10]. They are taken if, on other outcomes, they gain more than nothing by two standard errors,
    each outcome beside the policy's own on the same noise, and the worst is none the worse for it.
    So a search that finds nothing leaves the policy alone. Of several objectives that counts by
    which the goal is pursued [D31].
    """
    aims, by = objectives(config), pursued(config, models, state, goal)

    def own(s: Float[Array, " s"]) -> Float[Array, " a"]:
        return central(config, models, s, goal)

    def way(corrections: Float[Array, "horizon a"], noise: Float[Array, "horizon s"]) -> Array:
        def act(step: Int[Array, ""], s: Array) -> Float[Array, " a"]:
            return jnp.clip(own(s) + corrections[step], -1, 1)

        return rolled(models, act, state, noise)

    def returned(corrections: Array, noise: Array) -> Float[Array, ""]:
        states = way(corrections, noise)
        every = [
            aim.ahead(nearness(config, models, aim, states, goal), aim.read(V(states[-1], goal)))
            for aim, V in zip(aims, models.values, strict=False)
        ]
        return jnp.stack(every)[by]

    def found(
        now: tuple[Array, optax.OptState], _: None
    ) -> tuple[tuple[Array, optax.OptState], None]:
        corrections, optimiser = now
        slope = jax.grad(lambda c: -score(config, jax.vmap(lambda z: returned(c, z))(tried)))
        gradient = slope(corrections)
        gradient /= optax.tree.norm(gradient) + 1e-8
        change, optimiser = ascent.update(gradient, optimiser)
        return (jnp.clip(eqx.apply_updates(corrections, change), -2, 2), optimiser), None

    key_tried, key_checked = jax.random.split(key)
    shape = planning.horizon, state.size
    tried = jax.random.normal(key_tried, (planning.rollouts, *shape))
    checked = jax.random.normal(key_checked, (planning.checks, *shape))
    none = jnp.zeros((planning.horizon, *own(state).shape))
    ascent = optax.adam(planning.step)
    (corrections, _), _ = jax.lax.scan(found, (none, ascent.init(none)), length=planning.rounds)

    alone, other = (jax.vmap(lambda z, c=c: returned(c, z))(checked) for c in (none, corrections))
    gain = other - alone
    sure = gain.mean() > _SURE * gain.std() / jnp.sqrt(planning.checks - 1.0)
    corrected = sure & (score(config, other) >= score(config, alone))
    taken = jnp.where(corrected, corrections, 0)
    states = way(taken, jnp.zeros(shape))[:-1]
    actions = jnp.clip(jax.vmap(own)(states) + taken, -1, 1)
    return Planned(actions, corrected, gain.mean())
