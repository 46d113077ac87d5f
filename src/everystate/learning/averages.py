"""Averages of the weights over the last part of a run [D35]."""

from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from everystate.hyperparameters import Fitting

Tree = TypeVar("Tree")


def averaged(config: Fitting, average: Tree, models: Tree, update: Int[Array, ""]) -> Tree:
    """The average after so many updates, with the weights as they are after one more.

    It reaches over about the last `averaged` of the run so far, so that it needs no time constant
    and does not have to know when the run will end.
    """
    weight = 1 / jnp.maximum(config.averaged * update.astype(jnp.float32), 1)

    def mixed(old: Any, new: Any) -> Any:
        return old + weight * (new - old) if eqx.is_inexact_array(old) else new

    return jax.tree.map(mixed, average, models)
