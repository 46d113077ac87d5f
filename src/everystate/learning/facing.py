"""What is learned facing one way holds facing any: states as seen from where the body faces [D44].

On level ground a body does the same whichever way it faces, turned with it. So d, pi and V see
states and goals turned until the body faces along x, and d's change is turned back. What turns
is a fact of the body (`BodyVectorEnv.horizontal`), of many bodies nothing.
"""

import equinox as eqx
import jax.numpy as jnp
from flowjax.bijections import AbstractBijection
from jaxtyping import Array, Float

Horizontal = tuple[tuple[int, int], ...]
"""Where in a state x and y of horizontal vectors lie, the way that the body faces first."""
LEAST = 0.1
"""Shorter than this, in units, a body's nose points up or down, and it is not turned."""


def facing(horizontal: Horizontal, state: Float[Array, " s"]) -> Float[Array, " 2"]:
    """Cosine and sine of the way that a body faces in a scaled state."""
    ahead = state[jnp.array(horizontal[0])]
    square = jnp.sum(ahead**2)
    faces = square >= LEAST**2
    # Both branches of a `where` have a gradient: that of the root must not be of 0.
    length = jnp.sqrt(jnp.where(faces, square, 1.0))
    return jnp.where(faces, ahead / length, jnp.array([1.0, 0.0]))


def inward(
    horizontal: Horizontal, state: Float[Array, " s"], seen: Float[Array, " s"]
) -> Float[Array, " s"]:
    """A scaled state, goal or change as seen from where the body in `state` faces."""
    if not horizontal:
        return seen
    cosine, sine = facing(horizontal, state)
    return _turned(horizontal, seen, cosine, -sine)


def outward(
    horizontal: Horizontal, state: Float[Array, " s"], seen: Float[Array, " s"]
) -> Float[Array, " s"]:
    """The inverse of `inward`."""
    if not horizontal:
        return seen
    return _turned(horizontal, seen, *facing(horizontal, state))


class Outward(AbstractBijection):
    """The same as a part of a flow."""

    state: Float[Array, " s"]
    horizontal: Horizontal = eqx.field(static=True)
    shape: tuple[int, ...] = eqx.field(static=True)
    cond_shape: None = eqx.field(static=True)

    def __init__(self, horizontal: Horizontal, state: Float[Array, " s"]) -> None:
        self.horizontal, self.state = horizontal, state
        self.shape, self.cond_shape = state.shape, None

    def transform_and_log_det(self, x, condition=None):
        return outward(self.horizontal, self.state, jnp.asarray(x)), jnp.zeros(())

    def inverse_and_log_det(self, y, condition=None):
        return inward(self.horizontal, self.state, jnp.asarray(y)), jnp.zeros(())


def alike(horizontal: Horizontal, units: Float[Array, " s"]) -> Float[Array, " s"]:
    """Units in which x and y of what is horizontal have one in common, so that it can be turned."""
    if not horizontal:
        return units
    pairs = jnp.array(horizontal)
    both = jnp.sqrt(jnp.mean(units[pairs] ** 2, axis=1, keepdims=True))
    return units.at[pairs].set(jnp.broadcast_to(both, pairs.shape))


def about_zero(horizontal: Horizontal, centre: Float[Array, " s"]) -> Float[Array, " s"]:
    """A centre that is the same from all sides."""
    return centre.at[jnp.array(horizontal)].set(0.0) if horizontal else centre


def _turned(
    horizontal: Horizontal, seen: Array, cosine: Float[Array, ""], sine: Float[Array, ""]
) -> Array:
    x, y = jnp.array(horizontal).T
    a, b = seen[x], seen[y]
    return seen.at[x].set(cosine * a - sine * b).at[y].set(sine * a + cosine * b)
