"""The learned dynamics d(s'|s, a): a conditional flow over the change s' - s."""

import equinox as eqx
import jax
import jax.numpy as jnp
from flowjax.bijections import Chain
from flowjax.distributions import AbstractTransformed, StandardNormal, Transformed
from jaxtyping import Array, Float

from everystate.learning.flows import Conditional, Onwards


class Dynamics(eqx.Module):
    """d(s'|s, a), with the change in units of its own standard deviation."""

    change: Conditional
    change_scale: Float[Array, " s"]
    weights: Float[Array, " s"]
    """How much each component counts: see `components`."""

    def __call__(
        self, state: Float[Array, " s"], action: Float[Array, " a"]
    ) -> AbstractTransformed:
        """The distribution of s', scaled, given one scaled state and one action."""
        return self._after(state, self.change(jnp.concatenate([state, action])))

    def central(self, state: Float[Array, " s"], action: Float[Array, " a"]) -> Float[Array, " s"]:
        """The most central s'."""
        return state + self.scale * self.change.central(jnp.concatenate([state, action]))

    def fitted(self, state: Float[Array, " s"], action: Float[Array, " a"]) -> AbstractTransformed:
        """The distribution of s', as its likelihood may change it."""
        return self._after(state, self.change.fitted(jnp.concatenate([state, action])))

    @property
    def scale(self) -> Float[Array, " s"]:
        """The unit of the change, which is not trained."""
        return jax.lax.stop_gradient(self.change_scale)

    def _after(self, state: Float[Array, " s"], change: AbstractTransformed) -> AbstractTransformed:
        onwards = Onwards(state, self.scale)
        return Transformed(StandardNormal(state.shape), Chain([change.bijection, onwards]))
