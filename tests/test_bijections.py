"""The paper's two layers and their composition: inverses, log-determinants, seams, order."""

import equinox as eqx
import jax
import jax.extend
import jax.numpy as jnp
import numpy as np
import pytest
from flowjax.bijections import Chain, Invert, Scan

from everystate.learning.bijections import PLDU, SmoothPReLU, pldu_encoder

BIJECTIONS = {
    "PLDU": lambda key: PLDU(3, key=key),
    "PLDU with shift": lambda key: PLDU(3, shifted=True, key=key),
    "SmoothPReLU": lambda key: SmoothPReLU(3),
    "encoder, n = 1": lambda key: pldu_encoder(3, 1, key=key),
    "encoder, n = 2": lambda key: pldu_encoder(3, 2, key=key),
    "encoder, n = 3": lambda key: pldu_encoder(3, 3, key=key),
    "encoder, n = 6, with shifts": lambda key: pldu_encoder(3, 6, shifted=True, key=key),
    "encoder without alternation": lambda key: pldu_encoder(3, 3, alternate=False, key=key),
}


def randomised(tree, key, spread=0.4):
    """All learned parameters away from their initialisation; only the signs are fixed (B.1)."""
    leaves, structure = jax.tree_util.tree_flatten_with_path(tree)
    keys = jax.random.split(key, len(leaves))

    def moved(path, leaf, key):
        fixed = not eqx.is_inexact_array(leaf) or path[-1] == jax.tree_util.GetAttrKey("sign")
        return leaf if fixed else leaf + spread * jax.random.normal(key, leaf.shape, leaf.dtype)

    return structure.unflatten(
        [moved(path, leaf, key) for (path, leaf), key in zip(leaves, keys, strict=True)]
    )


@pytest.mark.parametrize("name", BIJECTIONS)
def test_inverse_and_log_determinants(name):
    with jax.enable_x64(True):
        key_new, key_random, key_x = jax.random.split(jax.random.key(0), 3)
        bijection = randomised(BIJECTIONS[name](key_new), key_random)

        for x in 2 * jax.random.normal(key_x, (4, *bijection.shape)):  # Meets all pieces of h.
            assert x.dtype == jnp.float64
            with jax.disable_jit():  # So few evaluations are not worth compiling.
                y, log_det = bijection.transform_and_log_det(x)
                back, log_det_back = bijection.inverse_and_log_det(y)
                jacobian = jax.jacfwd(bijection.transform)(x)
            np.testing.assert_allclose(back, x, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(log_det, np.linalg.slogdet(jacobian)[1], atol=1e-9)
            np.testing.assert_allclose(log_det_back, -log_det, atol=1e-9)


def test_a_new_matrix_is_a_rotation():
    layer = PLDU(31, key=jax.random.key(1))
    matrix = np.asarray(jax.vmap(layer.transform)(jnp.eye(31))).T
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(31), atol=1e-5)
    np.testing.assert_allclose(layer.log_d.sum(), 0, atol=1e-5)


def test_a_matrix_of_the_ants_size_inverts_in_single_precision():
    layer = PLDU(31, key=jax.random.key(1))
    layer = randomised(layer, jax.random.key(2), spread=0.2)
    x = jax.random.normal(jax.random.key(3), (31,))
    np.testing.assert_allclose(layer.inverse(layer.transform(x)), x, atol=5e-3)


def test_only_the_learned_parts_of_a_matrix_learn():
    layer = PLDU(3, key=jax.random.key(4))
    gradient = eqx.filter_grad(lambda layer: (layer.transform(jnp.arange(3.0)) ** 3).sum())(layer)
    assert np.all(np.asarray(gradient.sign) == 0)
    assert np.all(np.asarray(gradient.shift) == 0)  # The paper has none [D7].
    assert np.all(np.triu(gradient.lower) == 0)  # Unit-triangular, whatever is stored there.
    assert np.all(np.tril(gradient.upper) == 0)
    assert np.any(np.tril(gradient.lower, -1) != 0)
    assert np.any(np.triu(gradient.upper, 1) != 0)
    assert np.all(np.asarray(gradient.log_d) != 0)


def smooth_prelu(log_alpha, log_beta):
    """h of R^1 with those slopes."""
    h = SmoothPReLU(1)
    values = (jnp.full_like(h.log_alpha, log_alpha), jnp.full_like(h.log_beta, log_beta))
    return eqx.tree_at(lambda h: (h.log_alpha, h.log_beta), h, values)


def test_h_is_continuous_and_differentiable_at_its_seams():
    with jax.enable_x64(True):
        h = smooth_prelu(-0.7, 0.9)
        alpha, beta = np.exp(-0.7), np.exp(0.9)
        near = jnp.array([-1 - 1e-8, -1.0, -1 + 1e-8, 1 - 1e-8, 1.0, 1 + 1e-8])
        values = jax.vmap(h.transform)(near[:, None])[:, 0]
        slopes = jax.vmap(jax.jacobian(h.transform))(near[:, None])[:, 0, 0]
        back_slopes = jax.vmap(jax.jacobian(h.inverse))(values[:, None])[:, 0, 0]
        np.testing.assert_allclose(values, [-alpha] * 3 + [beta] * 3, atol=1e-7)
        np.testing.assert_allclose(slopes, [alpha] * 3 + [beta] * 3, atol=1e-7)
        np.testing.assert_allclose(back_slopes, 1 / np.array([alpha] * 3 + [beta] * 3), atol=1e-7)
        assert float(values[1]) == pytest.approx(-alpha, abs=1e-15)  # h(-1) = -alpha
        assert float(values[4]) == pytest.approx(beta, abs=1e-15)  # h(1) = beta
        np.testing.assert_allclose(h.inverse(jnp.array([-alpha])), [-1], atol=1e-12)
        np.testing.assert_allclose(h.inverse(jnp.array([beta])), [1], atol=1e-12)


@pytest.mark.parametrize("difference", [0.0, 1e-7, -1e-7])
def test_h_is_stable_where_its_slopes_are_equal(difference):
    h = smooth_prelu(0.3, 0.3 + difference)

    def total(h, y):
        x, log_det = h.inverse_and_log_det(y)
        return x.sum() + log_det

    for y in (-1e30, -1.35, -0.5, 0.0, 1.34, 7.0):
        x, log_det = h.inverse_and_log_det(jnp.array([y]))
        np.testing.assert_allclose(x, [y * np.exp(-0.3)], rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(log_det, -0.3, atol=1e-5)
        gradient = eqx.filter_grad(total)(h, jnp.array([y]))
        assert np.isfinite(gradient.log_alpha).all()
        assert np.isfinite(gradient.log_beta).all()


def test_h_is_finite_where_its_slopes_are_very_unequal():
    h = smooth_prelu(-9.0, 9.0)
    for x in (-3.0, -1.0, 0.0, 3.0):
        y, log_det = h.transform_and_log_det(jnp.array([x]))
        assert np.isfinite(log_det)
        assert np.isfinite(h.inverse_and_log_det(y)[1])
        assert np.isfinite(jax.jacobian(h.inverse)(y)).all()


def layers_of(encoder):
    """The layers in the order in which they are applied, with the scan's pairs unstacked."""
    match encoder:
        case Chain():
            return [layer for part in encoder.bijections for layer in layers_of(part)]
        case Scan():
            stacked, static = eqx.partition(encoder.bijection, eqx.is_array)
            count = len(jax.tree.leaves(stacked)[0])
            pairs = [jax.tree.map(lambda x, i=i: x[i], stacked) for i in range(count)]
            return [layer for pair in pairs for layer in layers_of(eqx.combine(pair, static))]
        case Invert():
            return layers_of(encoder.bijection)
    return [encoder]


def times(layer, x):
    """P L D U x, written out."""
    size = len(x)
    lower = np.tril(layer.lower, -1) + np.eye(size)
    upper = np.triu(layer.upper, 1) + np.eye(size)
    diagonal = np.diag(np.asarray(layer.sign) * np.exp(layer.log_d))
    return (lower @ diagonal @ upper @ x)[np.asarray(layer.permutation)]


def h(layer, x):
    """The smooth PReLU, written out."""
    alpha, beta = np.exp(layer.log_alpha), np.exp(layer.log_beta)
    middle = (beta - alpha) / 4 * (x**2 + 1) + (beta + alpha) / 2 * x
    return np.select([x <= -1, x >= 1], [alpha * x, beta * x], middle)


def h_inverse(layer, y):
    """Its inverse, by bisection."""
    low, high = np.full(len(y), -1e4), np.full(len(y), 1e4)
    for _ in range(100):
        centre = (low + high) / 2
        above = h(layer, centre) > y
        low, high = np.where(above, low, centre), np.where(above, centre, high)
    return low


@pytest.mark.parametrize(("n", "alternate"), [(2, True), (3, True), (20, True), (5, False)])
def test_layers_are_applied_in_the_order_of_the_formula(n, alternate):
    """W_1 h_1(W_2 h_2^-1(... W_n x)): odd nonlinearities are h, even ones its inverse."""
    with jax.enable_x64(True):
        encoder = pldu_encoder(2, n, alternate=alternate, key=jax.random.key(5))
        encoder = randomised(encoder, jax.random.key(6))
        layers = layers_of(encoder)
        assert [type(layer) for layer in layers] == [PLDU, SmoothPReLU] * (n - 1) + [PLDU]
        x = np.array([0.3, -1.2])
        expected = times(layers[0], x)
        for i, nonlinear, matrix in zip(
            range(n - 1, 0, -1), layers[1::2], layers[2::2], strict=True
        ):
            forwards = i % 2 == 1 or not alternate
            expected = (h if forwards else h_inverse)(nonlinear, expected)
            expected = times(matrix, expected)
        np.testing.assert_allclose(encoder.transform(jnp.asarray(x)), expected, rtol=1e-8)


def primitives(jaxpr):
    """Every equation, those of inner programs too."""
    for equation in jaxpr.eqns:
        yield equation
        for inner in jax.extend.core.jaxprs_in_params(equation.params):
            yield from primitives(inner)


def test_no_two_batches_of_decompositions_wait_for_each_other():
    """Two batched LAPACK calls at once used up JAX's threads: an ant's first step never came."""
    jaxpr = eqx.filter_make_jaxpr(lambda key: pldu_encoder(29, 20, key=key))(jax.random.key(0))[0]
    decompositions = [e for e in primitives(jaxpr.jaxpr) if e.primitive.name in ("lu", "geqrf")]
    assert decompositions
    assert all(e.invars[0].aval.ndim == 2 for e in decompositions)
