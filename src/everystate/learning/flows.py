"""Flow-based distributions: unconditional f, and conditional d, pi and c (2.4, B.1).

A conditional flow is a network that, given its condition, returns a distribution:
`policy(condition).log_prob(action)`. The network runs once per condition, however many samples
are drawn or scored.
"""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from flowjax import flows as flowjax_flows
from flowjax.bijections import AbstractBijection, Chain, Invert, RationalQuadraticSpline
from flowjax.distributions import AbstractTransformed, StandardNormal, Transformed
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import FlowFamily
from everystate.learning.bijections import PLDU, SmoothPReLU, pldu_encoder
from everystate.learning.networks import Network, small_at_first

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


class Conditional(eqx.Module):
    """A distribution given a condition: d, pi and c."""

    @abstractmethod
    def __call__(self, condition: Float[Array, " c"]) -> AbstractTransformed:
        """The distribution given one condition."""

    def central(self, condition: Float[Array, " c"]) -> Float[Array, " n"]:
        """The most central value, z = 0."""
        flow = self(condition)
        return decode(flow, jnp.zeros(flow.shape))

    def fitted(self, condition: Float[Array, " c"]) -> AbstractTransformed:
        """The distribution, as a likelihood may change it."""
        return self(condition)


class ConditionalFlow(Conditional):
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
        self.network = small_at_first(Network(condition_size, outputs, key=key_network, **network))

    def __call__(self, condition: Float[Array, " c"]) -> AbstractTransformed:
        parameters = _elementwise_parameters(self.encoder)
        ends = np.cumsum([parameter.size for parameter in parameters])
        moves = jnp.split(self.network(condition), ends[:-1])
        moved = [p + move.reshape(p.shape) for p, move in zip(parameters, moves, strict=True)]
        encoder = eqx.tree_at(_elementwise_parameters, self.encoder, moved)
        return Transformed(StandardNormal(encoder.shape), Invert(encoder))

    def columns(self) -> AbstractBijection:
        """The encoder, with which of the network's outputs move it in place of what they move."""
        parameters = _elementwise_parameters(self.encoder)
        ends = np.cumsum([parameter.size for parameter in parameters])
        places = [
            jnp.arange(end - p.size, end, dtype=jnp.int32).reshape(p.shape)
            for p, end in zip(parameters, ends, strict=True)
        ]
        return eqx.tree_at(_elementwise_parameters, self.encoder, places)


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


class FlowJAXConditionalFlow(Conditional):
    """One of FlowJAX's conditional flows behind the interface of `ConditionalFlow`."""

    bijection: AbstractBijection

    def __call__(self, condition: Float[Array, " c"]) -> AbstractTransformed:
        return Transformed(StandardNormal(self.bijection.shape), _Given(self.bijection, condition))


class Centred(Conditional):
    """A centre, found by a network of its own, and a conditional flow around it [D36].

    So the centre can be fitted by a squared error or a return, and the spread by a likelihood,
    and neither moves the parameters of the other.
    """

    centre: Network
    around: Conditional

    def __init__(
        self,
        size: int,
        condition_size: int,
        around: Conditional,
        *,
        key: PRNGKeyArray,
        **network: int,
    ) -> None:
        """A centre near 0 at first, in the middle of `around`, a flow on R^size."""
        self.centre = small_at_first(Network(condition_size, size, key=key, **network))
        self.around = around

    def __call__(self, condition: Float[Array, " c"]) -> AbstractTransformed:
        return self._about(self.centre(condition), condition)

    def central(self, condition: Float[Array, " c"]) -> Float[Array, " n"]:
        """The centre."""
        return self.centre(condition)

    def fitted(self, condition: Float[Array, " c"]) -> AbstractTransformed:
        """The distribution, whose centre no likelihood moves."""
        return self._about(jax.lax.stop_gradient(self.centre(condition)), condition)

    def _about(
        self, centre: Float[Array, " n"], condition: Float[Array, " c"]
    ) -> AbstractTransformed:
        spread = self.around(condition).bijection
        moved = Onwards(centre, jnp.ones_like(centre))
        return Transformed(StandardNormal(centre.shape), Chain([spread, moved]))


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
) -> Conditional:
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
