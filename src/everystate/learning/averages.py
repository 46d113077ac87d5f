"""Averages of the weights over the last part of a run [D35]."""

from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from everystate.config import Config
from everystate.learning.models import Models

Tree = TypeVar("Tree")


def averaged(config: Config, average: Models, models: Models, update: Int[Array, ""]) -> Models:
    """The average after so many updates, with the models as they are after one more.

    It reaches over about the last `averaged` of the run so far, so that it needs no time constant
    and does not have to know when the run will end.
    """
    weight = 1 / jnp.maximum(config.averaged * update.astype(jnp.float32), 1)
    return _mixed(average, models, weight)


def _mixed(old: Tree, new: Tree, weight: Float[Array, ""]) -> Tree:
    return jax.tree.map(
        lambda a, b: a + weight * (b - a) if eqx.is_inexact_array(a) else b, old, new
    )
