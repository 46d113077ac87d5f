"""The cartpole, observed in other ways: `altered:NAME` is a body where this folder is importable.

What moves is the same; only what is observed of it differs. See invariance.py.
"""

import functools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Shaped

from everystate.envs import Cartpole

_X, _SINE, _CART_VELOCITY = 0, 2, 3
_PLAIN = len(Cartpole().state_names)

Plain = Float[np.ndarray, "n 5"]
Observed = Float[np.ndarray, "n _"]


@dataclass(frozen=True)
class Altered(Cartpole):
    """The cartpole as it is: subclasses say what they change of a component, or add."""

    def factors(self) -> Float[np.ndarray, " 5"]:
        """By which its components are multiplied."""
        return np.ones(_PLAIN)

    def shifts(self) -> Float[np.ndarray, " 5"]:
        """Which are added to that."""
        return np.zeros(_PLAIN)

    def added(self, states: Plain) -> Observed:
        """Components that come after its own."""
        return np.empty((len(states), 0))

    def altered(self, states: Plain) -> Observed:
        """What is observed of states of the cartpole."""
        states = np.asarray(states, dtype=np.float64)
        return np.concatenate([states * self.factors() + self.shifts(), self.added(states)], axis=1)

    def plain(self, observations: Float[np.ndarray, "*n _"]) -> Float[np.ndarray, "*n 5"]:
        """The cartpole's states."""
        return (observations[..., :_PLAIN] - self.shifts()) / self.factors()

    @functools.cached_property
    def state_names(self) -> tuple[str, ...]:
        """Added ones have numbers."""
        more = self.added(np.zeros((1, _PLAIN))).shape[1]
        return (*super().state_names, *(f"added_{i}" for i in range(more)))

    @functools.cached_property
    def state_units(self) -> tuple[str, ...]:
        """Unknown."""
        return ("",) * len(self.state_names)

    @functools.cached_property
    def centre(self) -> tuple[float, ...]:
        """To be measured."""
        return (np.nan,) * len(self.state_names)

    @functools.cached_property
    def spread(self) -> tuple[float, ...]:
        """See `centre`."""
        return self.centre

    @functools.cached_property
    def high(self) -> tuple[float, ...]:
        """None is known."""
        return (np.inf,) * len(self.state_names)

    @functools.cached_property
    def low(self) -> tuple[float, ...]:
        """See `high`."""
        return (-np.inf,) * len(self.state_names)

    def initial(self, num: int, rng: np.random.Generator) -> Observed:
        """The cartpole's."""
        return self.altered(super().initial(num, rng))

    def observe(
        self, qpos: Float[np.ndarray, "envs nq"], qvel: Float[np.ndarray, "envs nv"]
    ) -> Observed:
        """What is left of it."""
        return self.altered(super().observe(qpos, qvel))

    def place(
        self, observations: Observed
    ) -> tuple[Float[np.ndarray, "envs nq"], Float[np.ndarray, "envs nv"]]:
        """Of added components nothing can be placed."""
        return super().place(self.plain(observations))

    def regions(self, observations: Float[np.ndarray, "*n _"]) -> Shaped[np.ndarray, "*n"]:
        """The cartpole's."""
        return super().regions(self.plain(observations))


class Rescaled(Altered):
    """The cart's velocity in millimetres."""

    def factors(self) -> Float[np.ndarray, " 5"]:
        """1,000 for one of them."""
        return np.where(np.arange(_PLAIN) == _CART_VELOCITY, 1000.0, 1.0)


class Shifted(Altered):
    """The cart's place from a point a thousand times as far away as it ever goes."""

    def shifts(self) -> Float[np.ndarray, " 5"]:
        """About 1,000 spreads for one of them."""
        return np.where(np.arange(_PLAIN) == _X, 1000.0, 0.0)


class Repeated(Altered):
    """The sine of the pole's angle five times."""

    def added(self, states: Plain) -> Observed:
        """Four more."""
        return np.repeat(states[:, [_SINE]], 4, axis=1)


class Constant(Altered):
    """A number that is always the same."""

    def added(self, states: Plain) -> Observed:
        """It."""
        return np.full((len(states), 1), 3.0)


class OfCopy(Altered):
    """A number for each copy of the body, as the place of a target would be."""

    def added(self, states: Plain) -> Observed:
        """By its place among the copies."""
        return np.random.default_rng(0).normal(size=(len(states), 1))


class Noise(Altered):
    """Four contact forces, as it were: mostly 0, else anything."""

    def added(self, states: Plain) -> Observed:
        """Digits of the state that no model tells, so that a run stays the same bit for bit."""
        mixed = (states * 1e5) @ np.random.default_rng(0).uniform(1, 2, (_PLAIN, 4))
        digits = np.modf(np.abs(np.sin(mixed) * 43758.5453))[0]
        return np.where(digits > 0.8, (digits - 0.8) * 10, 0.0)
