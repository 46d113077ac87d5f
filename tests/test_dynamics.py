"""What d is trained on."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flowjax.distributions import Normal

from everystate.learning.losses import dynamics_loss
from everystate.learning.replay import Transitions
from small import of_paper
from worlds import Known

SCALE, SPREAD = jnp.array([0.1, 2.0]), jnp.array([0.5, 3.0])


class Halfway(Known):
    """Says that an action leads half as far as it does."""

    def __init__(self) -> None:
        super().__init__()
        self.change_scale = SCALE

    def central(self, state, action):
        return state + action / 2

    def fitted(self, state, action):
        return Normal(self.central(state, action), SPREAD)


def loss(**fields):
    states, actions = np.random.default_rng(0).normal(size=(2, 6, 2)).astype(np.float32)
    moved = Transitions(*map(jnp.asarray, (states, actions, states + actions, states[:, :0])))
    config = of_paper(dynamics_noise=0.0, **fields)
    return float(dynamics_loss(config, Halfway(), moved, key=jax.random.key(0))), actions


def test_the_error_of_its_centre_counts_in_sds_of_the_change():
    (without, actions), (with_it, _) = loss(centre_weight=0.0), loss(centre_weight=3.0)
    error = ((actions / 2 / np.array(SCALE)) ** 2).sum(axis=1).mean()
    assert with_it - without == pytest.approx(3 * error, rel=1e-4)
    spread = np.array(SPREAD)
    density = -0.5 * (actions / 2 / spread) ** 2 - np.log(spread * np.sqrt(2 * np.pi))
    assert without == pytest.approx(-density.sum(axis=1).mean(), rel=1e-5)
