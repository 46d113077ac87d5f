"""A goal suite: fixed tasks, each from a start to a goal, so that numbers can be compared.

Each task has the physics of its start, its goal as it is observed, a horizon, and what kind it is.
Success is in units of `sigma`, the spread of each scored component over a reference set that never
changes.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from everystate.envs import BodyVectorEnv, Physics
from everystate.errors import EverystateError, suggest
from everystate.evaluation import metrics

Split = Literal["tune", "report"]
"""Suites of two seeds: one to look at while settings are chosen, one for what is published."""


@dataclass(frozen=True, eq=False)
class Suite:
    """What an evaluation asks of a body. Arrays are in the body's own units."""

    body: str
    name: str
    split: str
    notes: str
    seed: int
    """Seed from which the suite was made; the evaluation has its own."""
    components: tuple[str, ...]
    """Names of what `Body.scored` returns."""
    sigma: Float[np.ndarray, " scored"]
    angular: tuple[str, ...]
    """Components that are angles in radians: their differences are wrapped."""
    position: tuple[str, ...]
    """Components that position-only success looks at."""
    velocity: tuple[str, ...]
    """Components that are velocities; the closest approach is told of them and of all others."""
    starts: tuple[Physics, ...] | None
    """As `BodyVectorEnv.get_physics` has it; None for a body that can only be reset."""
    goals: Float[np.ndarray, "tasks state"]
    """Observations."""
    weights: Float[np.ndarray, "tasks scored"]
    """How much each component counts: 1, or 0 for one that is not asked for."""
    kinds: tuple[str, ...]
    """Of each task."""
    k: Int[np.ndarray, " tasks"]
    """Steps from start to goal on the recorded path that the task was cut from; 0 without one."""
    horizons: Int[np.ndarray, " tasks"]
    """Control steps given for each goal."""
    actions: tuple[Float[np.ndarray, "_ action"], ...] | None = None
    """Those that led from each start to its goal, for a suite cut from paths."""

    def __post_init__(self) -> None:
        what = f"suite {self.name!r} of {self.body}"
        for name, values in (("sigma", self.sigma), ("goals", self.goals), ("k", self.k)):
            if not np.isfinite(values).all():
                raise EverystateError(f"{what}: {name} must be finite numbers")
        if not (self.sigma > 0).all() or self.sigma.shape != (len(self.components),):
            raise EverystateError(
                f"{what}: sigma must be positive, one for each of {self.components}"
            )
        counts = {len(self.goals), len(self.horizons), len(self.kinds), len(self.k)}
        counts |= {len(x) for x in (self.starts, self.actions) if x is not None}
        if len(counts) != 1 or 0 in counts:
            raise EverystateError(
                f"{what}: starts, goals, kinds, k and horizons must be equally many, at least 1"
            )
        if self.horizons.min() < 1:
            raise EverystateError(
                f"{what}: horizon is {self.horizons.min()}: at least 1 step is needed"
            )
        if self.weights.shape != (len(self.goals), len(self.components)) or not (
            np.isfinite(self.weights).all() and (self.weights >= 0).all()
        ):
            raise EverystateError(f"{what}: weights must be 0 or more, one for each component")
        if not (self.weights > 0).any(axis=1).all():
            raise EverystateError(f"{what}: each task needs a component of a weight above 0")
        for name in (*self.angular, *self.position, *self.velocity):
            if name not in self.components:
                raise EverystateError(
                    f"{what} has no component {name!r}: {suggest(name, self.components)}"
                )

    @property
    def groups(self) -> dict[str, Bool[np.ndarray, " tasks"]]:
        """Which tasks are of which kind, of which k, and all."""
        kinds = np.array(self.kinds)
        found = {kind: kinds == kind for kind in dict.fromkeys(self.kinds)}
        found |= {f"k={k}": self.k == k for k in np.unique(self.k) if k > 0}
        return found | {"all": np.ones(len(kinds), dtype=bool)}

    @property
    def scored_by(self) -> tuple[str, str]:
        """Measure and reading, within 0.5 sigma, that make its one score.

        Of what can only be passed that is a hit, and of all else the end.
        """
        if self.name not in ("motion", "parts-motion"):
            return "max", "end"
        return metrics.chief(int((self.weights > 0).sum(axis=1).max())), "hit"

    def asked(self, state_names: Sequence[str]) -> Float32[np.ndarray, "tasks state"]:
        """The goals, NaN in each component of the state that is not asked for."""
        goals = self.goals.astype(np.float32)
        for i, name in enumerate(self.components):
            if name in state_names:
                goals[self.weights[:, i] == 0, state_names.index(name)] = np.nan
        return goals

    def subset(self, count: int) -> "Suite":
        """About evenly spaced tasks of the suite, which keeps the share of every kind."""
        if not 1 <= count <= len(self.goals):
            raise EverystateError(f"episodes is {count}: choose 1 to {len(self.goals)}")
        return self.only(np.linspace(0, len(self.goals) - 1, count).round().astype(int))

    def only(self, chosen: Int[np.ndarray, " n"]) -> "Suite":
        """These tasks of the suite."""

        def of(values: tuple | None) -> tuple | None:
            return None if values is None else tuple(values[i] for i in chosen)

        arrays = {n: getattr(self, n)[chosen] for n in ("goals", "weights", "k", "horizons")}
        lists = {n: of(getattr(self, n)) for n in ("starts", "kinds", "actions")}
        return dataclasses.replace(self, **arrays, **lists)

    def mask(self, names: tuple[str, ...]) -> Bool[np.ndarray, " scored"]:
        """Which scored components are named."""
        return np.array([name in names for name in self.components])

    def begin(self, env: BodyVectorEnv, seed: int) -> Float[np.ndarray, "tasks state"]:
        """Puts a body for each task to its start, or resets it; returns what they observe."""
        if self.starts is None:
            return env.reset(seed=seed)[0]
        env.set_physics(self.starts)
        return env.observe()
