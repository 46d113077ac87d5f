"""Every model's gradient is shortened on its own [D6], also of several policies."""

import jax.numpy as jnp
import numpy as np

from everystate.learning.models import _clipped


def test_a_long_gradient_of_one_policy_leaves_that_of_the_other_alone() -> None:
    clip = _clipped(1.0)
    long, short = jnp.array([30.0, 40.0]), jnp.array([0.3, 0.4])
    state = clip.init((long, short))
    found, _ = clip.update((long, short), state)
    np.testing.assert_allclose(found[0], long / 50)
    np.testing.assert_allclose(found[1], short)


def test_a_single_model_is_shortened_as_a_whole() -> None:
    clip = _clipped(1.0)
    gradient = {"weight": jnp.array([30.0]), "bias": jnp.array([40.0])}
    found, _ = clip.update(gradient, clip.init(gradient))
    np.testing.assert_allclose(found["weight"], [0.6])
    np.testing.assert_allclose(found["bias"], [0.8])
