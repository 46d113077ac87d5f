"""Further steps of the dynamics d, which learns from more than the minibatch of an update [D23]."""

import equinox as eqx
import jax
import optax
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning import replay as rb
from everystate.learning.dynamics import Dynamics
from everystate.learning.keys import named
from everystate.learning.losses import dynamics_loss
from everystate.learning.models import Models, step_one, trainable
from everystate.learning.replay import Transitions
from everystate.learning.sharding import split


def practise(
    config: Config,
    models: Models,
    optimisers: tuple[optax.OptState, ...],
    replay: rb.Replay,
    *,
    key: PRNGKeyArray,
) -> tuple[Models, tuple[optax.OptState, ...], dict[str, Float[Array, ""]]]:
    """`dynamics_updates` - 1 steps of d alone, each on transitions drawn for it.

    Returns models and optimisers with d and its own stepped, and the means of losses and norms.
    """
    more, at = config.dynamics_updates - 1, Models._fields.index("dynamics")
    if not more:
        return models, optimisers, {}
    drawn = rb.drawn_transitions(config, replay, more * config.batch_size, key=named(key, "drawn"))
    batches = jax.tree.map(lambda x: x.reshape(more, config.batch_size, -1), drawn)
    arrays, static = eqx.partition(models.dynamics, eqx.is_array)

    def one(
        carry: tuple[Dynamics, optax.OptState], now: tuple[Transitions, PRNGKeyArray]
    ) -> tuple[tuple[Dynamics, optax.OptState], tuple[Float[Array, ""], Float[Array, ""]]]:
        (arrays, optimiser), (batch, key) = carry, now
        batch = split(config, batch)
        dynamics = eqx.combine(arrays, static)

        def loss(new: Dynamics) -> Float[Array, ""]:
            return dynamics_loss(config, eqx.combine(new, dynamics), batch, key=key)

        value, gradient = jax.value_and_grad(loss)(trainable(dynamics))
        dynamics, optimiser = step_one(config, "dynamics", dynamics, gradient, optimiser)
        return (eqx.filter(dynamics, eqx.is_array), optimiser), (value, optax.tree.norm(gradient))

    steps = batches, jax.random.split(key, more)
    (arrays, optimiser), (loss, norm) = jax.lax.scan(one, (arrays, optimisers[at]), steps)
    return (
        models._replace(dynamics=eqx.combine(arrays, static)),
        (*optimisers[:at], optimiser, *optimisers[at + 1 :]),
        {"loss/d_practice": loss.mean(), "gradient/d_practice": norm.mean()},
    )
