"""The paper's algorithm in the sizes of preset `test`, for what is no part of `quick`."""

from typing import Any

from everystate.config import Config
from everystate.presets import TINY, preset


def of_paper(**fields: Any) -> Config:
    """Preset `paper` on the ramp, in seconds, with these fields."""
    named: dict[str, Any] = TINY | fields
    return preset("paper", **named)
