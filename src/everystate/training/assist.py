"""What every host but the first does: it lends its devices to the first one's updates."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from everystate.agent import skeleton
from everystate.config import Config
from everystate.training import hosts
from everystate.training.bodies import Steps, info, make_bodies
from everystate.training.collection import to_device
from everystate.training.learner import compiled


def assist(config: Config) -> None:
    """Takes part in every `observe` and `update` of the first host, until that one is done.

    State and transitions are the first one's; what is passed here has but their shapes.
    """
    env = make_bodies(config, 1)
    space = info(config, env).space
    env.close()
    if not hosts.go_on():
        return
    learner = compiled(config)
    state = hosts.shared(config, jax.tree.map(_blank, skeleton(config, space)))
    leading = config.steps_per_epoch, config.num_bodies
    states, actions = (np.zeros((*leading, size), np.float32) for size in space[:2])
    while hosts.go_on():
        state = learner.observe(state, to_device(Steps(states, actions, states, states)))
        state, *_ = learner.update(state)


def _blank(leaf: Any) -> Any:
    if not isinstance(leaf, jax.ShapeDtypeStruct):
        return leaf
    is_key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
    return jax.random.key(0) if is_key else jnp.zeros(leaf.shape, leaf.dtype)
