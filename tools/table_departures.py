"""The matrix of departures from the paper by preset, as `presets.py` has them."""

from table_cells import Rows, table

from everystate.presets import preset

# Every field in which the presets differ, by the departure that it belongs to; sizes have none.
_DEPARTURES: dict[str, tuple[str, ...]] = {
    "[D1]": ("weight_temper", "weight_clip"),
    "[D2]": ("patience",),
    "[D3]": ("state_noise", "dynamics_noise", "action_noise"),
    "[D4]": ("bound_value",),
    "[D5]": ("normalise_curriculum",),
    "[D6]": ("gradient_clip",),
    "[D7]": ("flow_shift",),
    "[D8]": ("target_period",),
    "[D9]": ("reward_space",),
    "[D10]": ("absorb",),
    "[D12]": ("max_gradient_step",),
    "[D13]": ("frequencies",),
    "[D14]": ("p_curric",),
    "[D15]": ("learning_rate",),
    "[D17]": ("goals", "m"),
    "[D18]": ("discount", "goal_value_weight"),
    "[D19]": ("approach_share",),
    "[D20]": ("both_goals",),
    "[D22]": ("wander_share",),
    "[D23]": ("dynamics_updates",),
    "[D24]": ("pursued_share", "central_share"),
    "[D25], [D26]": ("imagined_steps", "improved_share"),
    "[D28], [D36], [D37]": ("centre_weight", "centres"),
    "[D29]": ("relative_errors",),
    "[D30]": ("hindsight",),
    "[D31]": ("objective",),
    "[D32]": ("rare_share", "calm_share"),
    "[D33], [D39]": ("units",),
    "[D34]": ("kernel_width",),
    "[D35]": ("rate_halving", "averaged"),
    "[D38], [D45]": ("reward_shape",),
    "[D40]": ("kept_steps", "j", "N"),
    "[D41]": ("steepest",),
    "[D42]": ("value_stride",),
    "[D43]": ("steps_per_epoch",),
    "[D44]": ("any_heading",),
    "[D47]": ("interval",),
    "sizes": ("batch_size", "width", "depth", "state_layers", "curriculum_layers"),
    "the run": ("not_finite",),
}
_PRESETS = "literal", "paper", "quick"


@table
def departures() -> Rows:
    """A row per field."""
    configs = [preset(name) for name in _PRESETS]
    fields = [(departure, f) for departure, of_it in _DEPARTURES.items() for f in of_it]
    rows = [["", "field", *(f"`{name}`" for name in _PRESETS)]]
    for departure, field in fields:
        rows.append([departure, f"`{field}`", *(_said(getattr(c, field)) for c in configs)])
    return rows


def _said(value: object) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, str):
        return value
    return f"{value:,}" if isinstance(value, int) else f"{value:.3g}"
