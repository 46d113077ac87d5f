"""The learned dynamics d(s'|s, a): a conditional flow over the change s' - s."""

import equinox as eqx
import jax
import jax.numpy as jnp
from flowjax.bijections import Affine, Chain
from flowjax.distributions import AbstractTransformed, StandardNormal, Transformed
from jaxtyping import Array, Float

from everystate.learning.flows import ConditionalFlow, FlowJAXConditionalFlow


class Dynamics(eqx.Module):
    """d(s'|s, a), with the change in units of its own standard deviation."""

    change: ConditionalFlow | FlowJAXConditionalFlow
    change_scale: Float[Array, " s"]

    def __call__(
        self, state: Float[Array, " s"], action: Float[Array, " a"]
    ) -> AbstractTransformed:
        """The distribution of s', scaled, given one scaled state and one action."""
        change = self.change(jnp.concatenate([state, action])).bijection
        onwards = Affine(state, jax.lax.stop_gradient(self.change_scale))
        return Transformed(StandardNormal(state.shape), Chain([change, onwards]))
