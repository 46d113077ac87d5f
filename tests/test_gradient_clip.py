"""Every model's gradient is shortened on its own [D6], also of several policies."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from everystate.learning.models import _clipped


def shortened(gradient: Any) -> Any:
    clip = _clipped(1.0)
    return clip.update(gradient, clip.init(gradient))[0]


def test_a_long_gradient_of_one_policy_leaves_that_of_the_other_alone() -> None:
    long, short = jnp.array([30.0, 40.0]), jnp.array([0.3, 0.4])
    found = shortened((long, short))
    np.testing.assert_allclose(found[0], long / 50)
    np.testing.assert_allclose(found[1], short)


def test_a_single_model_is_shortened_as_a_whole() -> None:
    found = shortened({"weight": jnp.array([30.0]), "bias": jnp.array([40.0])})
    np.testing.assert_allclose(found["weight"], [0.6])
    np.testing.assert_allclose(found["bias"], [0.8])
