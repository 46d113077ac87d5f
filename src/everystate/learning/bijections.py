"""The two bijections of the paper's flows (2.4, B.1), as FlowJAX bijections.

Both read in the direction of f_enc: `transform` takes data towards the latent space.
"""

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


class PLDU(AbstractBijection):
    """x -> W x + shift with W = P L D U, D = diag(sign exp(log_d)) (B.1).

    P and the signs are fixed from the decomposition of a random orthogonal matrix; L and U are
    unit-triangular and learned. log|det W| = sum log_d. The paper has no shift: see `shifted`.
    """

    shape: tuple[int, ...] = eqx.field(static=True)
    cond_shape: None = eqx.field(static=True)
    shifted: bool = eqx.field(static=True)
    permutation: Int[Array, " n"]
    sign: Float[Array, " n"]
    lower: Float[Array, "n n"]
    upper: Float[Array, "n n"]
    log_d: Float[Array, " n"]
    shift: Float[Array, " n"]

    def __init__(self, size: int, *, shifted: bool = False, key: PRNGKeyArray) -> None:
        """A random rotation of R^size.

        Args:
            size: dimension n.
            shifted: whether the layer also learns a shift (not in the paper, deviation D7).
            key: random key.
        """
        # One layer after the other even under vmap: JAX gives a batch of decompositions to a pool of
        # threads and waits for it on one of them, so that two batches at once can wait for ever.
        decomposed = jax.custom_batching.sequential_vmap(
            lambda key: lu(jax.random.orthogonal(key, size))
        )
        permutation, lower, upper = decomposed(key)
        diagonal = jnp.diagonal(upper)
        self.shape = (size,)
        self.cond_shape = None
        self.shifted = shifted
        self.permutation = jnp.argmax(permutation, axis=1).astype(jnp.int32)
        self.sign = jnp.sign(diagonal)
        self.lower = lower
        self.upper = upper / diagonal[:, None]
        self.log_d = jnp.log(jnp.abs(diagonal))
        self.shift = jnp.zeros(size)

    def _triangles(self) -> tuple[Float[Array, "n n"], Float[Array, "n n"]]:
        identity = jnp.eye(self.shape[0])
        return jnp.tril(self.lower, -1) + identity, jnp.triu(self.upper, 1) + identity

    def transform_and_log_det(self, x, condition=None):
        x = jnp.asarray(x)
        lower, upper = self._triangles()
        scale = jax.lax.stop_gradient(self.sign) * jnp.exp(self.log_d)
        y = (lower @ (scale * (upper @ x)))[self.permutation]
        return y + self.shift if self.shifted else y, self.log_d.sum()

    def inverse_and_log_det(self, y, condition=None):
        y = jnp.asarray(y)
        lower, upper = self._triangles()
        scale = jax.lax.stop_gradient(self.sign) * jnp.exp(self.log_d)
        y = y - self.shift if self.shifted else y
        y = y[jnp.argsort(self.permutation)]
        y = _unit_triangular_inverse(lower) @ y / scale
        return _unit_triangular_inverse(upper) @ y, -self.log_d.sum()

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

    # Both directions are written so that a small slope survives beside a large one in float32.

    def transform_and_log_det(self, x, condition=None):
        x = jnp.asarray(x)
        alpha, beta = jnp.exp(self.log_alpha), jnp.exp(self.log_beta)
        middle = jnp.clip(x, -1, 1)  # Keeps the branch not taken from overflowing.
        curve = (beta * (1 + middle) ** 2 - alpha * (1 - middle) ** 2) / 4
        slope = (beta * (1 + middle) + alpha * (1 - middle)) / 2
        outside = jnp.where(x < 0, alpha * x, beta * x)
        return jnp.where(jnp.abs(x) < 1, curve, outside), jnp.log(slope).sum()

    def inverse_and_log_det(self, y, condition=None):
        y = jnp.asarray(y)
        alpha, beta = jnp.exp(self.log_alpha), jnp.exp(self.log_beta)
        a, b = (beta - alpha) / 4, (beta + alpha) / 2
        inside = (y > -alpha) & (y < beta)
        middle = jnp.clip(y, -alpha, beta)
        # The usual root formula divides by a, which is 0 at alpha = beta; this one does not.
        least = jnp.minimum(alpha, beta)
        slope = jnp.sqrt(jnp.maximum(alpha * beta + (beta - alpha) * middle, least**2))
        outside = jnp.where(y < 0, y / alpha, y / beta)
        log_outside = jnp.where(y < 0, self.log_alpha, self.log_beta)
        log_slope = jnp.where(inside, jnp.log(slope), log_outside)
        return jnp.where(inside, 2 * (middle - a) / (b + slope), outside), -log_slope.sum()

    def elementwise_parameters(self) -> list[Any]:
        """What a conditional flow sets per condition (B.1)."""
        return [self.log_alpha, self.log_beta]


def pldu_encoder(
    size: int, layers: int, *, shifted: bool = False, alternate: bool = True, key: PRNGKeyArray
) -> AbstractBijection:
    """f_enc(x) = W_1 h_1(W_2 h_2^-1(... W_n x)), h and its inverse alternating inwards (B.1).

    Args:
        size: dimension of x.
        layers: n, the number of matrices.
        shifted: whether matrices come with a shift [D7].
        alternate: False makes every nonlinearity an h, for the ablation.
        key: random key.
    """
    outermost, *keys = jax.random.split(key, layers)

    def matrix(key: PRNGKeyArray) -> PLDU:
        return PLDU(size, shifted=shifted, key=key)

    def pair(keys: Key[Array, "2"]) -> Chain:
        even = Invert(SmoothPReLU(size)) if alternate else SmoothPReLU(size)
        return Chain([matrix(keys[0]), even, matrix(keys[1]), SmoothPReLU(size)])

    # W_n comes first. An even n leaves one (W_n, h_{n-1}) before the pairs that end in h_1.
    single = [matrix(keys.pop()), SmoothPReLU(size)] if len(keys) % 2 else []
    pairs = []
    if keys:  # One scan over stacked pairs compiles in a fraction of the unrolled time.
        stacked = jnp.stack(keys).reshape(-1, 2)
        pairs = [Scan(eqx.filter_vmap(pair)(stacked))]
    return Chain([*single, *pairs, matrix(outermost)])
