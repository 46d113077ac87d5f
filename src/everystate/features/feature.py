"""A feature of a state, and what has features."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

from jaxtyping import Shaped

States = Shaped[Any, "*n state"]
Values = Shaped[Any, "*n"]


class Feature(NamedTuple):
    """One of them."""

    name: str
    unit: str
    components: tuple[str, ...]
    """Those of the state that say it."""
    like: int | None = None
    """The component of the state whose unit and spread it has; None for an angle."""
    bound: float = math.inf
    """It lies between this and its negative."""

    @property
    def periodic(self) -> bool:
        """Whether 360 is the same as 0."""
        return self.unit == "deg"

    def difference(self, one: Values, other: Values) -> Values:
        """one - other, the short way round."""
        return (one - other + 180) % 360 - 180 if self.periodic else one - other

    def spread(self, of_components: Shaped[Any, " state"]) -> Shaped[Any, ""] | float:
        """1 σ, from those of the components; of an angle, that of a direction which may be any."""
        return math.degrees(_SMALL) if self.like is None else of_components[self.like]


@runtime_checkable
class Part(Protocol):
    """A part of the body that has features."""

    @property
    def features(self) -> tuple[Feature, ...]: ...

    def read(self, states: States) -> dict[str, Values]:
        """Each of its features, by name."""
        ...

    def set(self, states: States, asked: Mapping[str, Values]) -> States:
        """The states with some of its features as asked."""
        ...


@dataclass(frozen=True)
class Turning:
    """A joint that turns right round, of which the state has cosine and sine."""

    name: str
    at: int
    """Where in the state the cosine lies, with the sine after it."""

    @property
    def features(self) -> tuple[Feature, ...]:
        """Its angle."""
        components = f"cos_{self.name}", f"sin_{self.name}"
        return (Feature(f"{self.name}_angle", "deg", components, bound=180.0),)

    def read(self, states: States) -> dict[str, Values]:
        """In degrees, from -180 to 180; 0 where the cosine is 1."""
        xp = states.__array_namespace__()
        angle = xp.atan2(states[..., self.at + 1], states[..., self.at])
        return {self.features[0].name: angle * DEGREES}

    def set(self, states: States, asked: Mapping[str, Values]) -> States:
        """As in `Part`."""
        xp = states.__array_namespace__()
        angle = asked[self.features[0].name] / DEGREES
        return replaced(states, {self.at: xp.cos(angle), self.at + 1: xp.sin(angle)})


DEGREES = 180 / math.pi
"""In a radian."""
_SMALL = 1 / math.sqrt(3)
"""σ of a component of a direction that may be any: for small angles the same in rad."""


def replaced(states: States, new: Mapping[int, Values]) -> States:
    """With other values in these components."""
    xp = states.__array_namespace__()
    columns = [new.get(i, states[..., i]) for i in range(states.shape[-1])]
    shape = states.shape[:-1]
    return xp.stack([xp.broadcast_to(xp.asarray(c), shape) for c in columns], axis=-1)
