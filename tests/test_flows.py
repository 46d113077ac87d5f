"""Flow densities: they integrate to one, agree with their samples, and follow their condition."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flowjax.distributions import AbstractTransformed

from everystate.hyperparameters import FlowFamily
from everystate.learning.conditional import Centred, ConditionalFlow, conditional_flow
from everystate.learning.flows import decode, encode, frozen, state_flow
from everystate.learning.models import Space, new_models
from everystate.presets import preset

FAMILIES: tuple[FlowFamily, ...] = (
    "pldu",
    "coupling-affine",
    "coupling-spline",
    "autoregressive-spline",
)
SMALL = {"state_layers": 3, "curriculum_layers": 3, "width": 8, "depth": 1, "flow_shift": True}


def randomised(tree, spread):
    """All learned parameters away from their initialisation; only the signs are fixed (B.1)."""
    leaves, structure = jax.tree_util.tree_flatten_with_path(tree)
    keys = jax.random.split(jax.random.key(1), len(leaves))

    def moved(path, leaf, key):
        fixed = not eqx.is_inexact_array(leaf) or path[-1] == jax.tree_util.GetAttrKey("sign")
        return leaf if fixed else leaf + spread * jax.random.normal(key, leaf.shape)

    parts = [moved(path, leaf, key) for (path, leaf), key in zip(leaves, keys, strict=True)]
    return structure.unflatten(parts)


def models(size, spread=0.3):
    """The models of a body of that size, all parameters away from their initialisation."""
    new = new_models(
        preset("test", **SMALL), Space(size, size), jnp.full(size, 0.2), key=jax.random.key(0)
    )
    moved = randomised(new, spread)
    return moved._replace(
        dynamics=eqx.tree_at(lambda d: d.change_scale, moved.dynamics, new.dynamics.change_scale)
    )


@eqx.filter_jit
def samples(flow: AbstractTransformed, count, key):
    """x = f_dec(z), z ~ N(0, I), with their log-densities."""
    x = jax.vmap(lambda z: decode(flow, z))(jax.random.normal(key, (count, *flow.shape)))
    return x, flow.log_prob(x)


@eqx.filter_jit
def log_densities(flow: AbstractTransformed, x):
    return flow.log_prob(x)


def quadrature(flow: AbstractTransformed):
    """Integrals of p and of p log p over a grid that holds practically all of p."""
    drawn = np.asarray(samples(flow, 20_000, jax.random.key(2))[0])
    size = flow.shape[0]
    middle, width = np.median(drawn, axis=0), np.ptp(drawn, axis=0)
    axes = [
        np.linspace(m - w, m + w, 20_001 if size == 1 else 801)
        for m, w in zip(middle, width, strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, size)
    log_p = np.asarray(log_densities(flow, jnp.asarray(grid, jnp.float32)), float)
    cell = np.prod([axis[1] - axis[0] for axis in axes])
    p = np.exp(log_p)
    return p.sum() * cell, (p * np.maximum(log_p, -1e3)).sum() * cell


@pytest.mark.parametrize("size", [1, 2])
def test_densities_integrate_to_one_and_agree_with_samples(size):
    new = models(size)
    flows = {
        "f(s)": new.state_flow,
        "c(s|g)": new.curriculum(jnp.full(size, -0.5)),
        "c(s|g) of another g": new.curriculum(jnp.full(size, 1.0)),
        "d(s'|s,a)": new.dynamics(jnp.full(size, 0.3), jnp.full(size, -1.0)),
    }
    for name, flow in flows.items():
        total, mean_log_p = quadrature(flow)
        assert total == pytest.approx(1, abs=2e-3), name
        log_p = np.asarray(samples(flow, 20_000, jax.random.key(3))[1])
        error = log_p.std() / np.sqrt(log_p.size)
        assert log_p.mean() == pytest.approx(mean_log_p, abs=5 * error + 2e-3), name


def test_other_conditions_give_other_densities():
    new = models(2)
    x = jnp.array([[0.2, -0.4], [1.0, 0.5]])
    conditions = jnp.array([[-1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    densities = np.stack([log_densities(new.curriculum(c), x) for c in conditions])
    assert np.all(np.abs(np.diff(densities, axis=0)) > 1e-3)


def test_an_untrained_conditional_flow_hardly_depends_on_its_condition():
    new = models(2, spread=0.0)
    x = jnp.array([0.2, -0.4])
    densities = [new.curriculum(c).log_prob(x) for c in jnp.array([[-1.0, 0.0], [0.0, 1.0]])]
    assert float(densities[0]) == pytest.approx(float(densities[1]), abs=0.05)
    assert isinstance(new.curriculum, ConditionalFlow)
    moves = new.curriculum.network(jnp.array([-1.0, 2.0]))
    np.testing.assert_allclose(moves, 0, atol=0.02)


@pytest.mark.parametrize("layers", [1, 2, 3, 6])
def test_a_frozen_flow_is_the_same_flow(layers):
    flow = state_flow(3, layers, family="pldu", shifted=True, key=jax.random.key(5))
    flow = randomised(flow, 0.1)
    x = jnp.array([0.3, -0.7, 1.1])
    for way in (encode, decode):
        np.testing.assert_allclose(way(frozen(flow), x), way(flow, x), rtol=1e-4, atol=1e-4)


class Counted(eqx.Module):
    """A network that counts its calls."""

    network: eqx.Module
    calls: list = eqx.field(static=True)

    def __call__(self, x):
        self.calls.append(1)
        return self.network(x)  # pyright: ignore[reportCallIssue]


def test_the_network_runs_once_per_condition():
    flow, calls = models(2).curriculum, []
    assert isinstance(flow, ConditionalFlow)
    counted = eqx.tree_at(lambda f: f.network, flow, Counted(flow.network, calls))
    density = counted(jnp.array([0.1, 0.2]))
    for z in (jnp.zeros(2), jnp.ones(2)):
        density.log_prob(decode(density, z))
    assert len(calls) == 1


def test_dynamics_are_those_of_the_change_in_its_own_units():
    dynamics = models(2).dynamics
    state, action, z = jnp.array([3.0, -2.0]), jnp.array([0.5, 0.1]), jnp.array([0.4, 1.2])
    change = dynamics.change(jnp.concatenate([state, action]))
    u, next_state = decode(change, z), decode(dynamics(state, action), z)
    np.testing.assert_allclose(next_state, state + dynamics.change_scale * u, rtol=1e-5)
    log_scale = jnp.log(jnp.abs(dynamics.change_scale)).sum()
    np.testing.assert_allclose(
        dynamics(state, action).log_prob(next_state), change.log_prob(u) - log_scale, atol=1e-3
    )


def centred():
    """A flow on R^2 around a centre, given one number; all parameters away from their start."""
    network: dict[str, Any] = {"width": 8, "depth": 1, "frequencies": 0}
    keys = jax.random.split(jax.random.key(3))
    around = ConditionalFlow(2, 1, 2, shifted=True, key=keys[0], **network)
    return randomised(Centred(2, 1, around, key=keys[1], **network), 0.3)


def test_a_centred_flow_is_the_flow_around_it_moved_there():
    flow, condition, z = centred(), jnp.array([0.4]), jnp.array([0.3, -1.1])
    around, whole = flow.around(condition), flow(condition)
    np.testing.assert_allclose(flow.central(condition), flow.centre(condition))
    moved = flow.centre(condition) + decode(around, z)
    np.testing.assert_allclose(decode(whole, z), moved, rtol=1e-5)
    np.testing.assert_allclose(encode(whole, moved), z, atol=1e-4)
    log_prob = around.log_prob(decode(around, z))
    np.testing.assert_allclose(whole.log_prob(moved), log_prob, atol=1e-4)
    np.testing.assert_allclose(flow.fitted(condition).log_prob(moved), log_prob, atol=1e-4)


def test_a_likelihood_moves_the_spread_alone_and_an_error_the_centre_alone():
    flow, condition, x = centred(), jnp.array([0.4]), jnp.array([0.5, 2.0])

    def moved(loss):
        """Whether a loss has a gradient of the centre's parameters, and of those around it."""
        gradient = eqx.filter_grad(loss)(flow)
        return tuple(
            any(bool(jnp.any(leaf != 0)) for leaf in jax.tree.leaves(part))
            for part in (gradient.centre, gradient.around)
        )

    assert moved(lambda flow: -flow.fitted(condition).log_prob(x)) == (False, True)
    assert moved(lambda flow: jnp.sum((flow.central(condition) - x) ** 2)) == (True, False)
    assert moved(lambda flow: -flow(condition).log_prob(x)) == (True, True)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_decodes_what_it_encodes(family: FlowFamily):
    shared = {"family": family, "shifted": True, "key": jax.random.key(4)}
    flow = randomised(state_flow(2, 2, **shared), 0.1)
    given = conditional_flow(2, 1, 2, **shared, width=8, depth=1, frequencies=0)
    given = randomised(given, 0.1)

    @eqx.filter_jit
    def there_and_back(flow: AbstractTransformed, x):
        return decode(flow, encode(flow, x)), flow.log_prob(x)

    x, densities = jnp.array([0.7, -1.6]), []
    for member in (flow, given(jnp.array([-2.0])), given(jnp.array([2.0]))):
        back, log_prob = there_and_back(member, x)
        np.testing.assert_allclose(back, x, atol=1e-3)
        densities.append(float(log_prob))
    assert np.isfinite(densities).all()
    assert densities[1] != densities[2]
