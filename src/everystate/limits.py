"""What each hyper-parameter may be."""

import math
from typing import Any, Literal, get_args, get_origin

from everystate.errors import EverystateError, suggest

RANGES: dict[str, tuple[float, float]] = {
    "seed": (0, 2**31 - 1),
    "m": (1, 10_000),
    "rare_share": (0, 1),
    "calm_share": (0, 1),
    "k": (1e-6, 1e6),
    "kernel_width": (0, 1e3),
    "j": (1, 1_000),
    "N": (1, 10_000),
    "percentile": (0, 100),
    "max_gradient_step": (0, math.inf),
    "sensor_noise": (0, 10),
    "imagined_weight": (0, 1e4),
    "steepest": (1e-3, math.inf),
    "imagined_steps": (0, 100),
    "kept_steps": (1, 100),
    "value_stride": (0, 100),
    "improved_share": (0, 1),
    "p_curric": (0, 1),
    "curriculum_share": (1e-6, 1),
    "capacity": (2, 100_000_000),
    "batch_size": (2, 1_000_000),
    "half_life": (1e-3, 1e9),
    "weight_temper": (0, 1),
    "weight_clip": (0, math.inf),
    "approach_share": (0, 1),
    "approach_steps": (1, 10_000),
    "pursued_share": (0, 1),
    "discount": (0, 1),
    "absorb": (0, 1),
    "goal_value_weight": (0, 1e3),
    "num_bodies": (1, 100_000),
    "collectors": (0, 10_000),
    "steps_per_epoch": (1, 100_000),
    "warmup_steps": (1, 100_000),
    "patience": (1, 100_000),
    "wander_share": (0, 1),
    "wander_steps": (1, 1_000_000),
    "interval": (0, 1_000),
    "central_share": (0, 1),
    "max_episode_steps": (1, 1_000_000),
    "num_updates": (1, 1_000_000),
    "dynamics_updates": (1, 10_000),
    "centre_weight": (0, 1e6),
    "target_period": (1, 1_000_000),
    "learning_rate": (0, 1),
    "rate_halving": (1e-3, math.inf),
    "averaged": (0, 1),
    "gradient_clip": (0, math.inf),
    "epochs": (1, 10_000_000),
    "depth": (1, 32),
    "width": (1, 16_384),
    "frequencies": (0, 16),
    "state_layers": (1, 200),
    "dynamics_layers": (1, 200),
    "policy_layers": (1, 200),
    "curriculum_layers": (1, 200),
    "state_noise": (0, 10),
    "dynamics_noise": (0, 10),
    "action_noise": (0, 10),
    "devices": (1, 65_536),
    "checkpoint_period": (1, 10_000_000),
    "evaluation_period": (0, 10_000_000),
}
"""Least and greatest value of each number of `Config`."""


def require_kind(name: str, value: object, kind: Any) -> None:
    """Complains of a value that is not of a field's type."""
    if get_origin(kind) is Literal:
        if value not in (choices := get_args(kind)):
            raise EverystateError(f"{name} = {value!r} is unknown: {suggest(str(value), choices)}")
        return
    if get_origin(kind) is tuple:
        if not (isinstance(value, tuple) and all(isinstance(item, str) for item in value)):
            raise EverystateError(f"{name} = {value!r} is no tuple of texts: give one")
        return
    accepted = (int, float) if kind is float else kind
    if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):
        raise EverystateError(f"{name} = {value!r} is not of type {kind.__name__}: give one")


def require_in_range(name: str, value: int | float) -> None:
    """Complains of a number outside its range."""
    low, high = RANGES[name]
    if not low <= value <= high:
        raise EverystateError(
            f"{name} = {value} is out of range: it must lie in [{low:g}, {high:g}]"
        )
