"""The learned dynamics d(s'|s, a): a conditional flow over the change s' - s."""

import equinox as eqx
import jax
import jax.numpy as jnp
from flowjax.bijections import Chain
from flowjax.distributions import AbstractTransformed, StandardNormal, Transformed
from jaxtyping import Array, Float

from everystate.learning.conditional import Conditional
from everystate.learning.facing import Horizontal, Outward, inward, outward
from everystate.learning.flows import Onwards


class Dynamics(eqx.Module):
    """d(s'|s, a), with the change in units of its own standard deviation."""

    change: Conditional
    change_scale: Float[Array, " s"]
    weights: Float[Array, " s"]
    """How much each component counts: see `components`."""
    horizontal: Horizontal = eqx.field(static=True)

    def __call__(
        self, state: Float[Array, " s"], action: Float[Array, " a"]
    ) -> AbstractTransformed:
        """The distribution of s', scaled, given one scaled state and one action."""
        return self._after(state, self.change(self._seen(state, action)))

    def central(self, state: Float[Array, " s"], action: Float[Array, " a"]) -> Float[Array, " s"]:
        """The most central s'."""
        change = self.scale * self.change.central(self._seen(state, action))
        return state + outward(self.horizontal, state, change)

    def fitted(self, state: Float[Array, " s"], action: Float[Array, " a"]) -> AbstractTransformed:
        """The distribution of s', as its likelihood may change it."""
        return self._after(state, self.change.fitted(self._seen(state, action)))

    @property
    def scale(self) -> Float[Array, " s"]:
        """The unit of the change, which is not trained."""
        return jax.lax.stop_gradient(self.change_scale)

    def _after(self, state: Float[Array, " s"], change: AbstractTransformed) -> AbstractTransformed:
        parts = [change.bijection, Onwards(state, self.scale)]
        if self.horizontal:  # Of both components of a vector the unit is the same.
            parts.insert(1, Outward(self.horizontal, state))
        return Transformed(StandardNormal(state.shape), Chain(parts))

    def _seen(self, state: Float[Array, " s"], action: Float[Array, " a"]) -> Float[Array, " n"]:
        return jnp.concatenate([inward(self.horizontal, state, state), action])
