"""The presets: which numbers a config begins with, for each body.

Deviations from the paper carry their number in `docs/algorithm.md`, in the form [D3].
"""

import math
from dataclasses import fields, replace
from typing import Any

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

# Smaller, for two cores.
_SMALL = {
    "batch_size": 256,
    "width": 128,
    "depth": 3,
    "state_layers": 6,
    "curriculum_layers": 6,
    "flow_shift": True,
    "frequencies": 3,
    "target_period": 20,
    "learning_rate": 2e-3,
    "goals": "visited",
    "m": 20,
    "weight_clip": 2.0,
    "reward_space": "state",
    "discount": 0.98,
    "goal_value_weight": 0.0,
    "approach_share": 0.5,
    "p_curric": 0.5,
    "j": 2,
    "N": 3,
}

# For any body: nothing in it knows which.
_ANY = _SMALL | {
    "units": "running",
    "any_heading": True,
    "capacity": 1_000_000,
    "m": 50,
    "rare_share": 0.5,
    "calm_share": 1 / 3,
    "N": 2,
    "objective": "hold-and-pass",
    "reward_shape": "two-slopes",
    "absorb": 0.1,
    "imagined_absorb": False,
    "relative_errors": True,
    "discount": 0.99,
    "kernel_width": 0.3,
    "both_goals": True,
    "centres": True,
    "centre_weight": 1.0,
    "dynamics_updates": 4,
    "batch_size": 128,
    "improved_share": 0.125,
    "imagined_weight": 50.0,
    "imagined_steps": 16,
    "imagined_targets": 1.0,
    "value_stride": 4,
    "steps_per_epoch": 200,
    "kept_steps": 8,
    "steepest": 10.0,
    "hindsight": False,
    "pursued_share": 0.5,
    "central_share": 0.5,
    "wander_share": 0.3,
    "averaged": 0.1,
    "rate_halving": 15.0,
    "not_finite": "roll-back",
    "epochs": 100,
}

# Three bodies have sets of their own still, tuned on them by measurement (docs/algorithm.md).
_TUNED = _SMALL | {
    "capacity": 100_000,
    "cooldown": 0.4,
    "absorb": 0.5,
    "relative_goals": True,
    "epochs": 200,
}

_TUNED_BODIES: dict[str, dict[str, Any]] = {
    # By these its policy balances, not only the search at act time.
    "cartpole": {
        "m": 1,
        "hindsight": False,
        "absorb": 0.1,
        "relative_errors": True,
        "centre_weight": 100.0,
        "imagined_weight": 50.0,
        "imagined_steps": 8,
        "imagined_absorb": False,
        "imagined_targets": 0.5,
        "pursued_share": 0.5,
        "central_share": 0.5,
        "not_finite": "roll-back",
        "epochs": 100,
    },
    # In 29 dimensions; of what lies still one learns nothing of motion.
    "ant": {
        "k": 0.5,
        "reward_shape": "rational",
        "frequencies": 0,
        "dynamics_layers": 1,
        "dynamics_updates": 16,
        "centre_weight": 100.0,
        "capacity": 300_000,
        "reward_space": "steps",
        "absorb_power": 6,
        "gradient_step": 10.0,
        "imagined_weight": 50.0,
        "imagined_steps": 8,
        "imagined_targets": 0.5,
        "pursued_share": 0.5,
        "central_share": 0.5,
        "wander_share": 0.3,
        "not_finite": "roll-back",
        "epochs": 180,
    },
    # The ramp has the paper's own goals: the rarest of those visited do as well, but no better.
    "ramp-pointmass": {
        "goals": "imagined",
        "m": 20,
        "weight_clip": 8.0,
        "reward_space": "latent",
        "discount": 1.0,
        "absorb": 1.0,
        "goal_value_weight": 1.0,
        "relative_goals": False,
        "approach_share": 0.0,
        "p_curric": 0.2,
        "j": 1,
        "N": 8,
        "epochs": 160,
    },
}

_TINY = {
    "capacity": 4_000,
    "batch_size": 32,
    "N": 4,
    "width": 16,
    "depth": 2,
    "state_layers": 3,
    "curriculum_layers": 3,
    "num_bodies": 10,
    "steps_per_epoch": 10,
    "warmup_steps": 20,
    "num_updates": 10,
    "target_period": 5,
    "patience": 5,
    "epochs": 3,
    "checkpoint_period": 1,
}

PRESETS = ("quick", "any", "paper", "literal", "test")


def preset(name: str, body: str = "ramp-pointmass", **overrides: object) -> Config:
    """The named preset for a body, with single fields replaced.

    `any` is one set of numbers for every body, for two cores; `quick` is the same but for the three
    bodies that have a set of their own. `paper` has every number of Appendix B with the stabilisers
    of `docs/algorithm.md` on, `literal` has them off, `test` runs in seconds.

    Raises:
        EverystateError: unknown preset or field, or a value out of range.
    """
    if name not in PRESETS:
        raise EverystateError(f"unknown preset {name!r}: {suggest(name, PRESETS)}")
    known = {field.name for field in fields(Config)}
    for field in overrides:
        if field not in known:
            raise EverystateError(f"unknown field {field!r}: {suggest(field, known)}")
    paper = _PAPER | _PAPER_BODIES.get(body, {"k": 10.0})
    for_any, tuned = _PAPER | {"k": 10.0} | _ANY, _TUNED_BODIES.get(body)
    quick = for_any if tuned is None else paper | _TUNED | tuned
    numbers = {
        "quick": quick,
        "any": for_any,
        "paper": paper,
        "literal": paper | _STABILISERS_OFF,
        "test": quick | _TINY,
    }
    return replace(Config(), **{**numbers[name], "body": body, **overrides})
