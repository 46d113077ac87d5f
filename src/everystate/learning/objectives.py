"""What V counts, and what is climbed by it: the paper's sum of rewards, or hit and stay.

V is a network with one output per count, here called heads. An objective says what these are, what
a way makes of them, which single number of them is climbed, how they are fitted, and how many steps
they amount to. A way of n steps is given by the closeness h of its n + 1 states to the goal, that
of where it begins included.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float

from everystate.config import Config
from everystate.learning import value

Heads = Float[Array, " heads"]
Way = Float[Array, " states"]
NO_FLOOR = -jnp.inf
"""For V itself, which is held by nothing."""


class PaperSum(NamedTuple):
    """One head, V: the sum of rewards -1 + h on the way (4.2, eq. 2), h being the closeness."""

    config: Config
    floor: Float[Array, ""] | float = NO_FLOOR
    """Lowest value that V_targ can have [D4]."""

    @property
    def heads(self) -> int:
        """How many outputs V has."""
        return 1

    def read(self, outputs: Heads) -> Heads:
        """The heads, from the network's outputs."""
        return outputs

    def counted(self, near: Way, last: Heads) -> Heads:
        """The heads where a way begins, from those where it ends: r + V_targ, what V is fitted to.

        `bound_value` holds V_targ within [floor, 0], the values it can truly have [D4]. It does so
        here rather than in the network: an output through softplus, once at 0, stayed there.
        """
        total = value.bounded(self.config, last, jnp.asarray(self.floor))
        for step in reversed(range(1, len(near))):
            total = near[step] - 1 + value.remaining(self.config, near[step]) * total
        return total

    def climbed(self, near: Way, last: Heads) -> Float[Array, ""]:
        """What the policy makes large over a way: reaching may end no count [D25]."""
        if self.config.imagined_absorb:
            return self.worth(self.counted(near, last))
        held = value.bounded(self.config, last, jnp.asarray(self.floor))
        return self.ahead(near, held)

    def ahead(self, near: Way, last: Heads) -> Float[Array, ""]:
        """What a search makes large over a way: reaching ends no count here [D10]."""
        total = last[0]
        for step in reversed(range(1, len(near))):
            total = near[step] - 1 + self.config.discount * total
        return total

    def worth(self, heads: Heads) -> Float[Array, ""]:
        """One number to choose by, in steps and at most 0."""
        return heads[0]

    def errors(
        self, outputs: Float[Array, "n heads"], targets: Float[Array, "n heads"]
    ) -> Float[Array, " n"]:
        """(V - v_targ)^2 (Algorithm 1), also per unit of 1 + |v_targ| [D29]."""
        squares = (outputs - targets) ** 2
        if self.config.relative_errors:
            squares /= 1 + jnp.abs(targets)
        return squares[:, 0]

    def steps(self, heads: Float[Array, "n heads"]) -> Float[Array, " n"]:
        """How many steps there are to the goal."""
        return value.steps(self.config, heads[:, 0])


class HitAndStay(NamedTuple):
    """Two heads in [0, 1]: how well and soon a goal is met, and for how long it is held [D31].

    Hit: the largest gamma^t h_t from now on, which is the value of stopping when it is best, with
    the closeness h as payoff: 1 at the goal, as V(s, s) = 0 has it (eq. 2). What comes after counts
    for nothing: so it asks for goals in motion, and for nothing more where one is met.
    Stay: the mean of h over time, with weights gamma^t: so it asks for rest where that is possible.
    """

    config: Config

    @property
    def heads(self) -> int:
        """How many outputs V has."""
        return 2

    def read(self, outputs: Heads) -> Heads:
        """The heads, from the network's outputs: at first nearly 0, as nothing is known to lead."""
        return jax.nn.sigmoid(outputs + _FIRST_LOGIT)

    def counted(self, near: Way, last: Heads) -> Heads:
        """The heads where a way begins, from those where it ends: what V is fitted to."""
        discount = self.config.discount
        hit, stay = jnp.maximum(near[-1], last[0]), last[1]
        for step in reversed(range(1, len(near))):
            hit = jnp.maximum(near[step - 1], discount * hit)
            stay = (1 - discount) * near[step] + discount * stay
        return jnp.stack([hit, stay])

    def climbed(self, near: Way, last: Heads) -> Float[Array, ""]:
        """What the policy makes large over a way."""
        return self.worth(self.counted(near, last))

    def ahead(self, near: Way, last: Heads) -> Float[Array, ""]:
        """What a search makes large over a way."""
        return self.climbed(near, last)

    def worth(self, heads: Heads) -> Float[Array, ""]:
        """One number to choose by, in steps and at most 0: both alike."""
        return (heads.sum() - 2) / (1 - self.config.discount)

    def errors(
        self, outputs: Float[Array, "n heads"], targets: Float[Array, "n heads"]
    ) -> Float[Array, " n"]:
        """Cross-entropy less the entropy of the targets, so that 0 is perfect."""
        outputs += _FIRST_LOGIT
        known = jnp.clip(targets, 1e-6, 1 - 1e-6)
        least = -known * jnp.log(known) - (1 - known) * jnp.log1p(-known)
        return (optax.sigmoid_binary_cross_entropy(outputs, targets) - least).sum(axis=1)

    def steps(self, heads: Float[Array, "n heads"]) -> Float[Array, " n"]:
        """How many steps there are to the goal: log hit / log gamma."""
        return jnp.log(jnp.maximum(heads[:, 0], 1e-4)) / jnp.log(self.config.discount)


Objective = PaperSum | HitAndStay
_FIRST_LOGIT = -4.0


def objective(config: Config, floor: Float[Array, ""] | float = NO_FLOOR) -> Objective:
    """That of a config; `floor` as in `PaperSum`."""
    return HitAndStay(config) if config.objective == "hit-and-stay" else PaperSum(config, floor)
