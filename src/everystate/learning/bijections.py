"""The two bijections of the paper's flows (2.4, B.1), as FlowJAX bijections.

Both read in the direction of f_enc: `transform` takes data towards the latent space.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from flowjax.bijections import AbstractBijection, Chain, Invert, Scan
from jax.scipy.linalg import lu
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray


def _unit_triangular_inverse(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """(I + M)^-1 = (I - M)(I + M^2)(I + M^4)..., exact because M is nilpotent.

    A triangular solve would do, but on the CPU it calls a BLAS whose waiting threads take the
    cores from XLA's: whole updates ran 8 times slower.
    """
    size = matrix.shape[0]
    identity = jnp.eye(size)
    power = identity - matrix
    inverse = identity + power
    for _ in range(1, max(1, (size - 1).bit_length())):
        power = power @ power
        inverse = inverse @ (identity + power)
    return inverse


class Linear(AbstractBijection):
    """x -> W x + shift, with W and its inverse worked out."""

    shape: tuple[int, ...] = eqx.field(static=True)
    cond_shape: None = eqx.field(static=True)
    matrix: Float[Array, "n n"]
    inverse_matrix: Float[Array, "n n"]
    shift: Float[Array, " n"]
    log_det: Float[Array, ""]

    def transform_and_log_det(self, x, condition=None):
        return jnp.asarray(x) @ self.matrix.T + self.shift, self.log_det

    def inverse_and_log_det(self, y, condition=None):
        return (jnp.asarray(y) - self.shift) @ self.inverse_matrix.T, -self.log_det


class PLDU(AbstractBijection):
    """x -> W x + shift with W = P L D U, D = diag(sign exp(log_d)) (B.1).

    P and the signs are fixed from the decomposition of a random orthogonal matrix; L and U are
    unit-triangular and learned. log|det W| = sum log_d. The paper has no shift: see `shifted`.
    """

    shape: tuple[int, ...] = eqx.field(static=True)
    cond_shape: None = eqx.field(static=True)
    shifted: bool = eqx.field(static=True)
    conditioned: bool = eqx.field(static=True)
    permutation: Int[Array, " n"]
    sign: Float[Array, " n"]
    lower: Float[Array, "n n"]
    upper: Float[Array, "n n"]
    log_d: Float[Array, " n"]
    shift: Float[Array, " n"]

    def __init__(
        self, size: int, *, shifted: bool = False, conditioned: bool = False, key: PRNGKeyArray
    ) -> None:
        """A random rotation of R^size.

        Args:
            size: dimension n.
            shifted: whether the layer also learns a shift (not in the paper, deviation D7).
            conditioned: whether D will vary from example to example.
            key: random key.
        """
        # One layer after the other, even under vmap: JAX gives a batch of decompositions to a pool
        # of threads and waits for it on one of them, so two batches at once can wait for ever.
        decomposed = jax.custom_batching.sequential_vmap(
            lambda key: lu(jax.random.orthogonal(key, size))
        )
        permutation, lower, upper = decomposed(key)
        diagonal = jnp.diagonal(upper)
        self.shape = (size,)
        self.cond_shape = None
        self.shifted = shifted
        self.conditioned = conditioned
        self.permutation = jnp.argmax(permutation, axis=1).astype(jnp.int32)
        self.sign = jnp.sign(diagonal)
        self.lower = lower
        self.upper = upper / diagonal[:, None]
        self.log_d = jnp.log(jnp.abs(diagonal))
        self.shift = jnp.zeros(size)

    def transform_and_log_det(self, x, condition=None):
        if not self.conditioned:
            return self.linear().transform_and_log_det(x)
        y = (self._scale() * (jnp.asarray(x) @ self._upper().T)) @ self._permuted_lower().T
        return y + self.shift if self.shifted else y, self.log_d.sum()

    def inverse_and_log_det(self, y, condition=None):
        if not self.conditioned:
            return self.linear().inverse_and_log_det(y)
        y = jnp.asarray(y) - self.shift if self.shifted else jnp.asarray(y)
        scaled = y @ self._permuted_lower_inverse().T / self._scale()
        return scaled @ _unit_triangular_inverse(self._upper()).T, -self.log_d.sum()

    def linear(self) -> Linear:
        """The same map as one matrix, which serves all examples where D does not vary."""
        scale = jnp.broadcast_to(self._scale()[:, None], self.lower.shape)
        return Linear(
            shape=self.shape,
            cond_shape=None,
            matrix=self._permuted_lower() @ (scale * self._upper()),
            inverse_matrix=_unit_triangular_inverse(self._upper())
            @ (self._permuted_lower_inverse() / scale),
            shift=self.shift if self.shifted else jnp.zeros_like(self.shift),
            log_det=self.log_d.sum(),
        )

    # P joins L, once for all examples: to permute each of them costs more than all the rest.

    def _permuted_lower(self) -> Float[Array, "n n"]:
        return self._lower()[self.permutation]

    def _permuted_lower_inverse(self) -> Float[Array, "n n"]:
        return _unit_triangular_inverse(self._lower())[:, self.permutation]

    def _lower(self) -> Float[Array, "n n"]:
        return jnp.tril(self.lower, -1) + jnp.eye(self.shape[0])

    def _upper(self) -> Float[Array, "n n"]:
        return jnp.triu(self.upper, 1) + jnp.eye(self.shape[0])

    def _scale(self) -> Float[Array, " n"]:
        return jax.lax.stop_gradient(self.sign) * jnp.exp(self.log_d)

    def elementwise_parameters(self) -> list[Any]:
        """What a conditional flow sets per condition (B.1)."""
        return [self.log_d, self.shift] if self.shifted else [self.log_d]


class SmoothPReLU(AbstractBijection):
    """alpha x below -1, beta x above 1, a (x^2 + 1) + b x between (B.1, misprint corrected).

    a = (beta - alpha) / 4 and b = (beta + alpha) / 2 make it continuous and differentiable.
    """

    shape: tuple[int, ...] = eqx.field(static=True)
    cond_shape: None = eqx.field(static=True)
    log_alpha: Float[Array, " n"]
    log_beta: Float[Array, " n"]

    def __init__(self, size: int) -> None:
        """The identity of R^size: alpha = beta = 1."""
        self.shape = (size,)
        self.cond_shape = None
        self.log_alpha = jnp.zeros(size)
        self.log_beta = jnp.zeros(size)

    # Both directions are written without branches, and so that a small slope survives beside a
    # large one in float32.

    def transform_and_log_det(self, x, condition=None):
        x = jnp.asarray(x)
        alpha, beta = jnp.exp(self.log_alpha), jnp.exp(self.log_beta)
        middle = jnp.clip(x, -1, 1)
        right, left = 1 + middle, 1 - middle
        y = beta * (right**2 / 4 + jnp.maximum(x - 1, 0)) - alpha * (
            left**2 / 4 + jnp.maximum(-1 - x, 0)
        )
        return y, jnp.log((beta * right + alpha * left) / 2).sum()

    def inverse_and_log_det(self, y, condition=None):
        y = jnp.asarray(y)
        alpha, beta = jnp.exp(self.log_alpha), jnp.exp(self.log_beta)
        middle = jnp.clip(y, -alpha, beta)
        # slope^2 = alpha beta + (beta - alpha) y, from the end where the slope is least.
        from_least = jnp.where(alpha < beta, middle + alpha, beta - middle)
        squared = jnp.minimum(alpha, beta) ** 2 + jnp.abs(beta - alpha) * from_least
        # The usual root formula divides by beta - alpha, which can be 0; this one does not.
        x = (4 * middle - (beta - alpha)) / (beta + alpha + 2 * jnp.sqrt(squared))
        beyond = jnp.maximum(y - beta, 0) / beta + jnp.minimum(y + alpha, 0) / alpha
        return x + beyond, -jnp.log(squared).sum() / 2

    def elementwise_parameters(self) -> list[Any]:
        """What a conditional flow sets per condition (B.1)."""
        return [self.log_alpha, self.log_beta]


class Recomputed(Chain):
    """A chain of which a gradient keeps only the input: the rest is quicker computed again."""

    def __init__(self, bijections: Sequence[AbstractBijection]) -> None:
        super().__init__(bijections)

    def transform_and_log_det(self, x, condition=None):
        return eqx.filter_checkpoint(Chain.transform_and_log_det)(self, x, condition)

    def inverse_and_log_det(self, y, condition=None):
        return eqx.filter_checkpoint(Chain.inverse_and_log_det)(self, y, condition)


def pldu_encoder(
    size: int,
    layers: int,
    *,
    shifted: bool = False,
    conditioned: bool = False,
    alternate: bool = True,
    key: PRNGKeyArray,
) -> AbstractBijection:
    """f_enc(x) = W_1 h_1(W_2 h_2^-1(... W_n x)), h and its inverse alternating inwards (B.1).

    Args:
        size: dimension of x.
        layers: n, the number of matrices.
        shifted: whether matrices come with a shift [D7].
        conditioned: whether their D will vary from example to example.
        alternate: False makes every nonlinearity an h, for the ablation.
        key: random key.
    """
    outermost, *keys = jax.random.split(key, layers)

    def matrix(key: PRNGKeyArray) -> PLDU:
        return PLDU(size, shifted=shifted, conditioned=conditioned, key=key)

    def pair(keys: Key[Array, "2"]) -> Recomputed:
        even = Invert(SmoothPReLU(size)) if alternate else SmoothPReLU(size)
        return Recomputed([matrix(keys[0]), even, matrix(keys[1]), SmoothPReLU(size)])

    # W_n comes first. An even n leaves one (W_n, h_{n-1}) before the pairs that end in h_1.
    single = [matrix(keys.pop()), SmoothPReLU(size)] if len(keys) % 2 else []
    pairs = []
    if keys:  # One scan over stacked pairs compiles in a fraction of the unrolled time.
        stacked = jnp.stack(keys).reshape(-1, 2)
        pairs = [Scan(eqx.filter_vmap(pair)(stacked))]
    return Chain([*single, *pairs, matrix(outermost)])
