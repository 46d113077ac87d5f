"""What one training run is: the groups of `hyperparameters.py`; `presets.py` sets them."""

from dataclasses import dataclass
from typing import Literal, get_type_hints

from everystate.errors import EverystateError
from everystate.hyperparameters import (
    Body,
    Buffers,
    Collection,
    Fitting,
    Goals,
    Networks,
    Pairs,
    PolicyImprovement,
    Returns,
    Units,
)
from everystate.limits import RANGES, require_in_range, require_kind

MODEL_COPY = "model_copy"
"""The body option that an agent read from a file has besides its own: where its copy of the model
lies. It is true of one machine, so no file has it."""


# From last to first: a dataclass has the fields of its last base first.
@dataclass(frozen=True)
class Config(
    Networks, Fitting, Collection, Buffers, Pairs, PolicyImprovement, Returns, Units, Goals, Body
):
    """What one training run is: the body, the seed, and every number of the algorithm."""

    epochs: int = 100
    """Epochs of the run."""
    devices: int = 1
    """Devices, of all hosts together, that share out every minibatch."""
    checkpoint_period: int = 10
    """Epochs between checkpoints."""
    evaluation_period: int = 0
    """Epochs between evaluations on the body's goal suite during training; 0 is never."""
    not_finite: Literal["stop", "roll-back"] = "stop"
    """What an update with a loss or gradient that is not finite does: stop the run, or leave the
    models as they were and go on with the next."""

    @property
    def improved_pairs(self) -> int:
        """Of a minibatch, those for which candidates are compared."""
        return max(1, round(self.improved_share * self.batch_size))

    def __post_init__(self) -> None:
        for name, kind in get_type_hints(Config).items():
            require_kind(name, getattr(self, name), kind)
        for name in RANGES:
            require_in_range(name, getattr(self, name))
        if self.num_updates % self.target_period:
            raise EverystateError(
                f"target_period = {self.target_period} does not divide num_updates = "
                f"{self.num_updates}: choose a divisor, so that every epoch copies V alike"
            )
        if self.collectors and self.num_bodies % self.collectors:
            raise EverystateError(
                f"collectors = {self.collectors} does not divide num_bodies = {self.num_bodies}: "
                f"choose {_nearest_divisor(self.num_bodies, self.collectors)}, so that each has as "
                f"many bodies"
            )
        if self.batch_size % self.devices:
            raise EverystateError(
                f"devices = {self.devices} does not divide batch_size = {self.batch_size}: choose "
                f"a divisor, or a batch_size of {_multiple(self.batch_size, self.devices)}, so "
                f"that every device has as many examples"
            )
        if self.improved_share < 1 and not self.imagined_steps:
            raise EverystateError(
                f"improved_share = {self.improved_share} leaves pairs without a target, and "
                f"imagined_steps = 0 gives them none: set the former to 1, or raise the latter"
            )
        if self.objective == "hold-and-pass" and not self.imagined_steps:
            raise EverystateError(
                "objective = 'hold-and-pass' counts a hit on whole ways, and imagined_steps = 0 "
                "imagines none: raise it, or set objective to 'paper-sum'"
            )
        if self.reward_shape == "two-slopes" and self.reward_space != "state":
            raise EverystateError(
                f"reward_shape = 'two-slopes' counts in states and in steps, and reward_space = "
                f"{self.reward_space!r} says otherwise: set reward_space to 'state'"
            )
        if self.any_heading and self.units != "running":
            raise EverystateError(
                f"any_heading needs units that are the same from all sides, and units = "
                f"{self.units!r} are the body's: set units to 'running', or any_heading to false"
            )
        if self.kept_steps > max(self.imagined_steps, 1):
            raise EverystateError(
                f"kept_steps = {self.kept_steps} is more than imagined_steps = "
                f"{self.imagined_steps}, on which actions are kept: lower it, or raise the other"
            )
        if self.value_stride and not self.imagined_steps:
            raise EverystateError(
                f"value_stride = {self.value_stride} has V learn on imagined ways, and "
                f"imagined_steps = 0 has it learn of none: set value_stride to 0, or raise "
                f"imagined_steps"
            )
        if self.improved_pairs % self.devices:
            raise EverystateError(
                f"devices = {self.devices} does not divide the {self.improved_pairs} pairs that "
                f"improved_share = {self.improved_share} of batch_size = {self.batch_size} makes: "
                f"choose an improved_share or a batch_size that gives a multiple of it"
            )
        ring = self.num_bodies * max(self.steps_per_epoch, self.warmup_steps)
        if self.capacity % self.num_bodies or self.capacity < 2 * ring:
            raise EverystateError(
                f"capacity = {self.capacity} must be a multiple of num_bodies = {self.num_bodies} "
                f"and hold at least two collection phases ({2 * ring} items): raise capacity"
            )


def _nearest_divisor(number: int, wanted: int) -> int:
    divisors = (d for d in range(1, number + 1) if number % d == 0)
    return min(divisors, key=lambda d: abs(d - wanted))


def _multiple(size: int, of: int) -> int:
    return -(-size // of) * of
