"""The learned dynamics d(s'|s, a): a conditional flow over the change s' - s."""

import equinox as eqx
import jax
import jax.numpy as jnp
from flowjax.bijections import AbstractBijection, Chain
from flowjax.distributions import AbstractTransformed, StandardNormal, Transformed
from jaxtyping import Array, Float

from everystate.learning.flows import ConditionalFlow, FlowJAXConditionalFlow


class _Onwards(AbstractBijection):
    """change -> state + scale * change.

    FlowJAX's `Affine` checks its scale by a callback to the host, and a program with callbacks is
    not kept in the compile cache.
    """

    state: Float[Array, " s"]
    scale: Float[Array, " s"]
    shape: tuple[int, ...] = eqx.field(static=True)
    cond_shape: None = eqx.field(static=True)

    def __init__(self, state: Float[Array, " s"], scale: Float[Array, " s"]) -> None:
        self.state, self.scale = state, scale
        self.shape, self.cond_shape = state.shape, None

    def transform_and_log_det(self, x, condition=None):
        return self.state + self.scale * jnp.asarray(x), jnp.log(self.scale).sum()

    def inverse_and_log_det(self, y, condition=None):
        return (jnp.asarray(y) - self.state) / self.scale, -jnp.log(self.scale).sum()


class Dynamics(eqx.Module):
    """d(s'|s, a), with the change in units of its own standard deviation."""

    change: ConditionalFlow | FlowJAXConditionalFlow
    change_scale: Float[Array, " s"]

    def __call__(
        self, state: Float[Array, " s"], action: Float[Array, " a"]
    ) -> AbstractTransformed:
        """The distribution of s', scaled, given one scaled state and one action."""
        change = self.change(jnp.concatenate([state, action])).bijection
        onwards = _Onwards(state, jax.lax.stop_gradient(self.change_scale))
        return Transformed(StandardNormal(state.shape), Chain([change, onwards]))
