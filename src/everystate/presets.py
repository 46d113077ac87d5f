"""The presets: which numbers a config begins with.

Deviations from the paper carry their number in `docs/algorithm.md`, in the form [D3].
"""

import math
from dataclasses import fields, replace

from everystate.config import Config
from everystate.errors import EverystateError, suggest

# Appendix B varies only k and h between bodies.
_PAPER_BODIES: dict[str, dict[str, float]] = {
    "ramp-pointmass": {"k": 100.0, "half_life": 20.0},
    "cartpole": {"k": 10.0, "half_life": 20.0},
    "ant": {"k": 10.0, "half_life": 50.0},
}

_STABILISERS_OFF = {
    "weight_temper": 1.0,
    "weight_clip": math.inf,
    "patience": 1,
    "state_noise": 0.0,
    "dynamics_noise": 0.0,
    "action_noise": 0.0,
    "bound_value": False,
    "normalise_curriculum": False,
    "gradient_clip": math.inf,
    "max_gradient_step": math.inf,
}

_PAPER = {
    "capacity": 1_000_000,
    "weight_temper": 0.5,
    "weight_clip": 8.0,
    "patience": 20,
    "gradient_clip": 10.0,
    "max_gradient_step": 1.0,
}

# Smaller, for two cores, and for any body: nothing in it knows which.
_QUICK = {
    "batch_size": 128,
    "width": 128,
    "depth": 3,
    "state_layers": 6,
    "curriculum_layers": 6,
    "flow_shift": True,
    "frequencies": 3,
    "target_period": 20,
    "learning_rate": 2e-3,
    "goals": "visited",
    "m": 50,
    "rare_share": 0.5,
    "calm_share": 1 / 3,
    "weight_clip": 2.0,
    "units": "running",
    "any_heading": True,
    "objective": "hold-and-pass",
    "reward_space": "state",
    "reward_shape": "two-slopes",
    "kernel_width": 0.3,
    "discount": 0.99,
    "absorb": 0.1,
    "relative_errors": True,
    "goal_value_weight": 0.0,
    "approach_share": 0.5,
    "p_curric": 0.5,
    "j": 2,
    "N": 2,
    "both_goals": True,
    "centres": True,
    "centre_weight": 1.0,
    "dynamics_updates": 4,
    "improved_share": 0.125,
    "kept_steps": 8,
    "imagined_steps": 16,
    "value_stride": 4,
    "steepest": 10.0,
    "steps_per_epoch": 200,
    "interval": 0,
    "hindsight": False,
    "pursued_share": 0.5,
    "central_share": 0.5,
    "wander_share": 0.3,
    "averaged": 0.1,
    "rate_halving": 15.0,
    "not_finite": "roll-back",
}

TINY = {
    "capacity": 4_000,
    "batch_size": 32,
    "N": 4,
    "width": 16,
    "depth": 2,
    "state_layers": 3,
    "curriculum_layers": 3,
    "num_bodies": 10,
    "steps_per_epoch": 10,
    "interval": 1,
    "warmup_steps": 20,
    "num_updates": 10,
    "target_period": 5,
    "patience": 5,
    "epochs": 3,
    "checkpoint_period": 1,
}
"""Sizes by which any preset runs in seconds."""

PRESETS = ("quick", "paper", "literal", "test")


def preset(name: str, body: str = "ramp-pointmass", **overrides: object) -> Config:
    """The named preset for a body, with single fields replaced.

    `quick` is one set of numbers for every body, for two cores. `paper` has every number of
    Appendix B with the stabilisers of `docs/algorithm.md` on, `literal` has them off, `test` is
    `quick` in seconds.

    Raises:
        EverystateError: unknown preset or field, or a value out of range.
    """
    if name not in PRESETS:
        raise EverystateError(f"unknown preset {name!r}: {suggest(name, PRESETS)}")
    known = {field.name for field in fields(Config)}
    for field in overrides:
        if field not in known:
            raise EverystateError(f"unknown field {field!r}: {suggest(field, known)}")
    paper, quick = _PAPER | _PAPER_BODIES.get(body, {"k": 10.0}), _PAPER | _QUICK
    numbers = {
        "quick": quick,
        "paper": paper,
        "literal": paper | _STABILISERS_OFF,
        "test": quick | TINY,
    }
    return replace(Config(), **{**numbers[name], "body": body, **overrides})
