"""All that training changes."""

from typing import NamedTuple

import optax
from jaxtyping import Array, Int, PRNGKeyArray

from everystate.learning.episodes import Episodes
from everystate.learning.models import Models, Scale
from everystate.learning.networks import Value
from everystate.learning.replay import Replay


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

    @property
    def kept(self) -> Models:
        """What makes the agent that is kept."""
        return self.average or self.models
