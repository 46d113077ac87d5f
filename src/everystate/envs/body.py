"""What the batched stepper must know about a body: one small class per MuJoCo model."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import mujoco.batch
import numpy as np
from jaxtyping import Bool, Float, Shaped


@dataclass(frozen=True)
class Body(ABC):
    """A MuJoCo model, how it is driven, and what of it is observed.

    Subclasses are frozen dataclasses without arrays: everything that changes during a run lives in
    the stepper. `centre` and `spread` are nominal: `(observation - centre) / spread` is about
    [-1, 1] or of unit standard deviation over the states the body can reach.
    """

    name: ClassVar[str]
    xml: ClassVar[Path]
    frame_skip: ClassVar[int]
    state_names: ClassVar[tuple[str, ...]]
    state_units: ClassVar[tuple[str, ...]]
    centre: ClassVar[tuple[float, ...]]
    spread: ClassVar[tuple[float, ...]]
    low: ClassVar[tuple[float, ...]]
    high: ClassVar[tuple[float, ...]]
    camera: ClassVar[str]
    # A goal's ghost is drawn this much larger, to be seen around a body that has reached it.
    ghost_scale: ClassVar[float] = 1.0

    @abstractmethod
    def initial(self, num: int, rng: np.random.Generator) -> Float[np.ndarray, "envs state"]:
        """Observations to start from."""

    @abstractmethod
    def observe(
        self, qpos: Float[np.ndarray, "envs nq"], qvel: Float[np.ndarray, "envs nv"]
    ) -> Float[np.ndarray, "envs state"]:
        """What the agent sees of a physics state."""

    @abstractmethod
    def place(
        self, observations: Float[np.ndarray, "envs state"]
    ) -> tuple[Float[np.ndarray, "envs nq"], Float[np.ndarray, "envs nv"]]:
        """A full physics state (qpos, qvel) that is observed as given; also draws goals."""

    def drive(
        self, actions: Float[np.ndarray, "envs action"], rng: np.random.Generator
    ) -> Float[np.ndarray, "envs nu"]:
        """Motor signals of one control step, from actions already clipped to [-1, 1]."""
        return actions

    def finish(self, batch: mujoco.batch.Batch) -> None:
        """Whatever a control step still has to do after its `frame_skip` physics steps."""
        return

    def regions(self, observations: Float[np.ndarray, "*n state"]) -> Shaped[np.ndarray, "*n"]:
        """The name of the part of the world each state lies in; success is told by part."""
        return np.full(observations.shape[:-1], "all")

    def scored(self, observations: Float[np.ndarray, "*n state"]) -> Float[np.ndarray, "*n scored"]:
        """What a success metric compares between a state and its goal."""
        return observations

    def falls(
        self, before: Float[np.ndarray, "*n state"], after: Float[np.ndarray, "*n state"]
    ) -> Bool[np.ndarray, "*n"]:
        """Whether the control step from `before` to `after` was a fall."""
        return np.zeros(before.shape[:-1], dtype=bool)
