"""All that training changes."""

from typing import NamedTuple

import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Int, PRNGKeyArray

from everystate.config import Config
from everystate.learning.episodes import Episodes, no_episodes
from everystate.learning.facing import Horizontal
from everystate.learning.models import Models, Scale, new_optimisers
from everystate.learning.networks import Value
from everystate.learning.policy import Policy
from everystate.learning.replay import Replay, empty


class Actor(NamedTuple):
    """What acting needs of an agent, which is little: it goes to wherever the bodies are."""

    policies: tuple[Policy, ...]
    values: tuple[Value, ...]
    scale: Scale
    weights: Float[Array, " s"]
    """Of the components of a state [D39]."""

    @property
    def horizontal(self) -> Horizontal:
        """Components that turn with the body, as its models see them [D44]."""
        return self.policies[0].horizontal


class AgentState(NamedTuple):
    """All that training changes."""

    models: Models
    target_values: tuple[Value, ...]
    optimisers: tuple[optax.OptState, ...]  # One per model.
    replay: Replay
    episodes: Episodes
    scale: Scale
    key: PRNGKeyArray
    epoch: Int[Array, ""]
    copies: Int[Array, ""]  # Of V to V_targ.
    average: Models | None  # Of the weights; None: there is none [D35].

    @classmethod
    def begun(
        cls, config: Config, models: Models, action_size: int, scale: Scale, key: PRNGKeyArray
    ) -> "AgentState":
        """With untrained models and nothing seen."""
        zero, (state_size,) = jnp.zeros((), jnp.int32), scale.centre.shape
        return cls(
            models=models,
            target_values=models.values,
            optimisers=new_optimisers(config, models),
            replay=empty(config, state_size, action_size),
            episodes=no_episodes(config, state_size),
            scale=scale,
            key=key,
            epoch=zero,
            copies=zero,
            average=models if config.averaged else None,
        )

    @property
    def horizontal(self) -> Horizontal:
        """As of `Actor`."""
        return self.actor.horizontal

    @property
    def actor(self) -> Actor:
        """The part that acts."""
        models = self.models
        return Actor(models.policies, models.values, self.scale, models.dynamics.weights)

    @property
    def kept(self) -> Models:
        """What makes the agent that is kept."""
        return self.average or self.models
