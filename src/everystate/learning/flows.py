"""Flow-based distributions, and the unconditional one of states, f (2.4, B.1)."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from flowjax import flows as flowjax_flows
from flowjax.bijections import AbstractBijection, Invert, RationalQuadraticSpline
from flowjax.distributions import AbstractTransformed, StandardNormal, Transformed
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.hyperparameters import FlowFamily
from everystate.learning.bijections import PLDU, pldu_encoder

# Latent space to data space, and back: the two directions of a flow, under the paper's names.


def encode(flow: AbstractTransformed, x: Float[Array, " n"]) -> Float[Array, " n"]:
    """z = f_enc(x), one example."""
    return flow.bijection.inverse(x)


def decode(flow: AbstractTransformed, z: Float[Array, " n"]) -> Float[Array, " n"]:
    """x = f_dec(z), one example."""
    return flow.bijection.transform(z)


def frozen(flow: AbstractTransformed) -> AbstractTransformed:
    """The same, with the matrices of its unconditional layers worked out, for repeated use."""

    def linear(node: Any) -> Any:
        if not isinstance(node, PLDU) or node.conditioned:
            return node
        stacked = node.lower.ndim == 3
        return eqx.filter_vmap(PLDU.linear)(node) if stacked else node.linear()

    return jax.tree.map(linear, flow, is_leaf=lambda node: isinstance(node, PLDU))


def state_flow(
    size: int,
    layers: int,
    *,
    family: FlowFamily,
    shifted: bool,
    alternate: bool = True,
    key: PRNGKeyArray,
) -> AbstractTransformed:
    """An unconditional density on R^size with `layers` layers: f(s)."""
    if family == "pldu":
        encoder = pldu_encoder(size, layers, shifted=shifted, alternate=alternate, key=key)
        return Transformed(StandardNormal((size,)), Invert(encoder))
    return Transformed(StandardNormal((size,)), flowjax_bijection(family, size, None, layers, key))


class Onwards(AbstractBijection):
    """x -> start + scale * x.

    FlowJAX's `Affine` checks its scale by a callback to the host, and a program with callbacks is
    not kept in the compile cache.
    """

    start: Float[Array, " n"]
    scale: Float[Array, " n"]
    shape: tuple[int, ...] = eqx.field(static=True)
    cond_shape: None = eqx.field(static=True)

    def __init__(self, start: Float[Array, " n"], scale: Float[Array, " n"]) -> None:
        self.start, self.scale = start, scale
        self.shape, self.cond_shape = start.shape, None

    def transform_and_log_det(self, x, condition=None):
        return self.start + self.scale * jnp.asarray(x), jnp.log(self.scale).sum()

    def inverse_and_log_det(self, y, condition=None):
        return (jnp.asarray(y) - self.start) / self.scale, -jnp.log(self.scale).sum()


def flowjax_bijection(
    family: FlowFamily, size: int, condition_size: int | None, layers: int, key: PRNGKeyArray
) -> AbstractBijection:
    """One of FlowJAX's own, from latent space to data space."""
    base = StandardNormal((size,))
    shared = {"base_dist": base, "cond_dim": condition_size, "flow_layers": layers, "invert": True}
    spline = RationalQuadraticSpline(knots=8, interval=4.0)
    match family:
        case "coupling-affine":
            return flowjax_flows.coupling_flow(key, **shared).bijection
        case "coupling-spline":
            return flowjax_flows.coupling_flow(key, transformer=spline, **shared).bijection
        case "autoregressive-spline":
            return flowjax_flows.masked_autoregressive_flow(
                key, transformer=spline, **shared
            ).bijection
    raise AssertionError(family)
