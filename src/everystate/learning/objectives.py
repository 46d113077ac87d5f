"""What a policy and its V are learned for: the paper's sum of rewards, or one hit.

An objective says how near a state is to a goal, what V counts along a way, what of it the policy
climbs, how V is fitted, and how many steps a value amounts to. A way of n steps is given by the
closeness h of its n + 1 states to the goal, that of where it begins included. A run learns a policy
and a V for each of its `objectives`.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int

from everystate.hyperparameters import Returns
from everystate.learning import rewards, value

Way = Float[Array, " states"]
NO_FLOOR = -jnp.inf
"""For V itself, which is held by nothing."""


class PaperSum(NamedTuple):
    """The sum of rewards -1 + h on the way (4.2, eq. 2): it asks to be near, and to stay so."""

    config: Returns
    floor: Float[Array, ""] | float = NO_FLOOR
    """Lowest value that V_targ can have [D4]."""

    suffix = ""
    """Of the names of its losses and random keys."""
    cautious = False
    """Whether the policy climbs the worst of N ways, or any one: by the worst it tries nothing."""

    def closeness(
        self, place: Float[Array, " s"], place_goal: Float[Array, " s"]
    ) -> Float[Array, ""]:
        """h, in [0, 1]."""
        return rewards.closeness(self.config, place, place_goal)

    def read(self, output: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """V, from the network's output."""
        return output

    def counted(self, near: Way, last: Float[Array, ""]) -> Float[Array, " steps"]:
        """V along a way, from V_targ where it ends: r + V_targ, what V is fitted to.

        `bound_value` holds V_targ within [floor, 0], the values it can truly have [D4]. It does so
        here rather than in the network: an output through softplus, once at 0, stayed there.
        """
        total = value.bounded(self.config, last, jnp.asarray(self.floor))
        along = []
        for step in reversed(range(1, len(near))):
            total = near[step] - 1 + value.remaining(self.config, near[step]) * total
            along.append(total)
        return jnp.stack(along[::-1])

    def climbed(self, near: Way, last: Float[Array, ""]) -> Float[Array, ""]:
        """What the policy makes large over a way: reaching ends no count here [D25]."""
        return self.ahead(near, value.bounded(self.config, last, jnp.asarray(self.floor)))

    def ahead(self, near: Way, last: Float[Array, ""]) -> Float[Array, ""]:
        """What a search makes large over a way: reaching ends no count here [D10]."""
        total = last
        for step in reversed(range(1, len(near))):
            total = near[step] - 1 + self.config.discount * total
        return total

    def worth(self, known: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """V in steps, at most 0."""
        return known

    def errors(
        self, outputs: Float[Array, " n"], targets: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """(V - v_targ)^2 (Algorithm 1), also per unit of 1 + |v_targ| [D29]."""
        squares = (outputs - targets) ** 2
        return squares / (1 + jnp.abs(targets)) if self.config.relative_errors else squares

    def steps(self, known: Float[Array, " n"]) -> Float[Array, " n"]:
        """How many steps there are to the goal."""
        return value.steps(self.config, known)


class Hit(NamedTuple):
    """The largest gamma^t h_t from now on: how well and how soon a goal is met [D31].

    That is the value of stopping when it is best, with the closeness h as payoff: 1 at the goal, as
    V(s, s) = 0 has it (eq. 2). What comes after counts for nothing: so it asks for goals in motion,
    and for nothing more where one is met.
    """

    config: Returns

    suffix = "_pass"
    """Of the names of its losses and random keys."""
    cautious = True
    """The best moment of a way may be luck, so of N ways it climbs the worst (eq. 3)."""

    def closeness(
        self, place: Float[Array, " s"], place_goal: Float[Array, " s"]
    ) -> Float[Array, ""]:
        """h, in [0, 1]: flat at the goal itself, so that near enough is met."""
        return rewards.closeness(self.config, place, place_goal, "exponential")

    def read(self, output: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """V in [0, 1], from the network's output: nearly 0 at first, as nothing leads there yet."""
        return jax.nn.sigmoid(output + FIRST_LOGIT)

    def counted(self, near: Way, last: Float[Array, ""]) -> Float[Array, " steps"]:
        """V along a way, from V_targ where it ends: what V is fitted to."""
        hit, along = jnp.maximum(near[-1], last), []
        for step in reversed(range(len(near) - 1)):
            hit = jnp.maximum(near[step], self.config.discount * hit)
            along.append(hit)
        return jnp.stack(along[::-1])

    def climbed(self, near: Way, last: Float[Array, ""]) -> Float[Array, ""]:
        """What the policy makes large over a way."""
        return self.worth(self.counted(near, last)[0])

    def ahead(self, near: Way, last: Float[Array, ""]) -> Float[Array, ""]:
        """What a search makes large over a way."""
        return self.climbed(near, last)

    def worth(self, known: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """V in steps, at most 0, so that it weighs as much as the paper's sum."""
        return (known - 1) / (1 - self.config.discount)

    def errors(
        self, outputs: Float[Array, " n"], targets: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """Cross-entropy less the entropy of the targets, so that 0 is perfect."""
        logits, known = outputs + FIRST_LOGIT, jnp.clip(targets, 1e-6, 1 - 1e-6)
        least = -known * jnp.log(known) - (1 - known) * jnp.log1p(-known)
        return optax.sigmoid_binary_cross_entropy(logits, targets) - least

    def steps(self, known: Float[Array, " n"]) -> Float[Array, " n"]:
        """How many steps there are to the goal: log hit / log gamma."""
        return jnp.log(jnp.maximum(known, 1e-4)) / jnp.log(self.config.discount)


Objective = PaperSum | Hit
HOLD, PASS = 0, 1
"""Which of the objectives is which, where there are both."""
HITS = 2
"""The V, beside those of the objectives, of the hit that the policy which holds comes to."""
NEAR, HELD, AS_SOON = 0.5, 0.05, 0.8
"""How close a goal is nearly met, what share of all that can be lost holding it may cost, and with
what share of the hit of passing it is as good to hold, as that V promises too much."""
FIRST_LOGIT = -4.0
"""Of a hit, where the network says 0."""


def objectives(
    config: Returns, floor: Float[Array, ""] | float = NO_FLOOR
) -> tuple[Objective, ...]:
    """Those of a config; `floor` as in `PaperSum`."""
    held = PaperSum(config, floor)
    return (held, Hit(config)) if config.objective == "hold-and-pass" else (held,)


class Reading(NamedTuple):
    """What a V tells of a policy."""

    of: int
    """Which of the policies; there is one for each objective."""
    aim: Objective
    suffix: str
    """Of the names of its loss and random key."""


def readings(aims: Sequence[Objective]) -> tuple[Reading, ...]:
    """Of each V: that of each objective tells of its policy, another the hits of what holds."""
    own = tuple(Reading(number, aim, aim.suffix) for number, aim in enumerate(aims))
    return own if len(own) == 1 else (*own, Reading(HOLD, aims[PASS], "_hits"))


def worths(
    config: Returns, values: Sequence[Callable], state: Float[Array, " s"], goal: Float[Array, " s"]
) -> Float[Array, " objectives"]:
    """What the V of each objective says of (s, g), in steps."""
    every = enumerate(objectives(config))
    return jnp.stack([aim.worth(aim.read(values[i](state, goal))) for i, aim in every])


def pursued(
    config: Returns, models: Any, state: Float[Array, " s"], goal: Float[Array, " s"]
) -> Int[Array, ""]:
    """By which of its objectives an agent goes for a goal: to pass, until it can be held.

    It is held, if it can be: if it costs little to be sent there from there. That is V(g, g) of the
    sum, which goes from 0, for nothing lost at any time, to -1 / (1 - gamma), for all of it. Until
    it is nearly met, what passes goes for it where it will hit it better or sooner: what holds
    knows no long ways, and what passes has no slope to follow where it knows no way at all.

    Args:
        config: hyper-parameters.
        models: anything with `values`, `state_flow` and `dynamics`, as in `Models`.
        state: s, scaled.
        goal: g, scaled.
    """
    if len(models.values) == 1:
        return jnp.zeros((), jnp.int32)
    place, aim = rewards.placing(config, models), objectives(config)[PASS]
    met = aim.closeness(place(state), place(goal)) >= NEAR
    passed, hit = (aim.read(models.values[i](state, goal)) for i in (PASS, HITS))
    held = (met | (hit >= AS_SOON * passed)) & holdable(config, models.values, goal)
    return jnp.where(held, jnp.int32(HOLD), jnp.int32(PASS))


def holdable(
    config: Returns, values: Sequence[Callable], goal: Float[Array, " s"]
) -> Bool[Array, ""]:
    """Whether the agent can stay at a goal, scaled; of a single objective that is not known.

    See `pursued`.
    """
    if len(values) == 1:
        return jnp.zeros((), bool)
    return values[HOLD](goal, goal) >= -HELD / (1 - config.discount)
