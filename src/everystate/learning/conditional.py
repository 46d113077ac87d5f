"""Conditional flows: d, pi and c (2.4, B.1).

Each is a network that, given its condition, returns a distribution:
`policy(condition).log_prob(action)`. The network runs once per condition, however many samples
are drawn or scored.
"""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from flowjax.bijections import AbstractBijection, Chain, Invert
from flowjax.distributions import AbstractTransformed, StandardNormal, Transformed
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.hyperparameters import FlowFamily
from everystate.learning.bijections import PLDU, SmoothPReLU, pldu_encoder
from everystate.learning.flows import Onwards, decode, flowjax_bijection
from everystate.learning.networks import Network, small_at_first


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
    return FlowJAXConditionalFlow(flowjax_bijection(family, size, condition_size, layers, key))
