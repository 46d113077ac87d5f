"""Flow-based distributions: unconditional f, and conditional d, pi and c (2.4, B.1).

A conditional flow is a network that, given its condition, returns a distribution:
`policy(condition).log_prob(action)`. The network runs once per condition, however many samples
are drawn or scored.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from flowjax import flows as flowjax_flows
from flowjax.bijections import AbstractBijection, Invert, RationalQuadraticSpline
from flowjax.distributions import AbstractTransformed, StandardNormal, Transformed
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import FlowFamily
from everystate.learning.bijections import PLDU, SmoothPReLU, pldu_encoder
from everystate.learning.networks import Network

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
    return Transformed(StandardNormal((size,)), _flowjax_bijection(family, size, None, layers, key))


class ConditionalFlow(eqx.Module):
    """A PLDU flow whose log d, log alpha and log beta move with a condition (B.1).

    The network's output is added to learned unconditional values; L and U stay unconditioned.
    """

    encoder: AbstractBijection
    network: Network

    def __init__(
        self,
        size: int,
        condition_size: int,
        layers: int,
        *,
        shifted: bool,
        alternate: bool = True,
        key: PRNGKeyArray,
        **network: int,
    ) -> None:
        """Sizes are those of the variable and of its condition; see `state_flow`."""
        key_encoder, key_network = jax.random.split(key)
        self.encoder = pldu_encoder(
            size, layers, shifted=shifted, conditioned=True, alternate=alternate, key=key_encoder
        )
        outputs = sum(p.size for p in _elementwise_parameters(self.encoder))
        start = Network(condition_size, outputs, key=key_network, **network)
        # Small last weights: at first the flow hardly depends on its condition.
        self.network = eqx.tree_at(
            lambda n: (n.mlp.layers[-1].weight, n.mlp.layers[-1].bias),
            start,
            replace_fn=lambda x: 0.01 * x,
        )

    def __call__(self, condition: Float[Array, " c"]) -> AbstractTransformed:
        """The distribution given one condition."""
        parameters = _elementwise_parameters(self.encoder)
        ends = np.cumsum([parameter.size for parameter in parameters])
        moves = jnp.split(self.network(condition), ends[:-1])
        moved = [p + move.reshape(p.shape) for p, move in zip(parameters, moves, strict=True)]
        encoder = eqx.tree_at(_elementwise_parameters, self.encoder, moved)
        return Transformed(StandardNormal(encoder.shape), Invert(encoder))


def _elementwise_parameters(tree: Any) -> list[Any]:  # Also of tree_at's stand-ins.
    def ours(node: object) -> bool:
        return isinstance(node, PLDU | SmoothPReLU)

    layers = [node for node in jax.tree.leaves(tree, is_leaf=ours) if ours(node)]
    return [parameter for layer in layers for parameter in layer.elementwise_parameters()]


class _Given(AbstractBijection):
    """A FlowJAX conditional bijection with its condition filled in."""

    bijection: AbstractBijection
    condition: Float[Array, " c"]
    shape: tuple[int, ...] = eqx.field(static=True)
    cond_shape: None = eqx.field(static=True)

    def __init__(self, bijection: AbstractBijection, condition: Float[Array, " c"]) -> None:
        self.bijection, self.condition = bijection, condition
        self.shape, self.cond_shape = bijection.shape, None

    def transform_and_log_det(self, x, condition=None):
        return self.bijection.transform_and_log_det(x, self.condition)

    def inverse_and_log_det(self, y, condition=None):
        return self.bijection.inverse_and_log_det(y, self.condition)


class FlowJAXConditionalFlow(eqx.Module):
    """One of FlowJAX's conditional flows behind the interface of `ConditionalFlow`."""

    bijection: AbstractBijection

    def __call__(self, condition: Float[Array, " c"]) -> AbstractTransformed:
        """The distribution given one condition."""
        return Transformed(StandardNormal(self.bijection.shape), _Given(self.bijection, condition))


def conditional_flow(
    size: int,
    condition_size: int,
    layers: int,
    *,
    family: FlowFamily,
    shifted: bool,
    alternate: bool = True,
    key: PRNGKeyArray,
    **network: int,
) -> ConditionalFlow | FlowJAXConditionalFlow:
    """A density on R^size given a condition in R^condition_size: d, pi and c."""
    if family == "pldu":
        return ConditionalFlow(
            size,
            condition_size,
            layers,
            shifted=shifted,
            alternate=alternate,
            key=key,
            **network,
        )
    return FlowJAXConditionalFlow(_flowjax_bijection(family, size, condition_size, layers, key))


def _flowjax_bijection(
    family: FlowFamily, size: int, condition_size: int | None, layers: int, key: PRNGKeyArray
) -> AbstractBijection:
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
