"""Formats of exported agents, and what makes of an older one one of today's."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from everystate.errors import EverystateError
from everystate.learning.objectives import FIRST_LOGIT

FORMAT = 10
HITLESS = 9
"""The format of agents that know hits of what passes alone."""
SWITCHED = 8
"""The format of agents that may have learned by settings that are gone."""
CUSPED = 7
"""The format of agents that may hold goals by a cusp alone."""
UNTURNED = 6
"""The format of agents that see which way they face."""
UNVISITED = 5
"""The format of agents without states that were visited."""
STEEP = 4
"""The format of networks whose waves are all of one amplitude."""
SINGLE = 3
"""The format before that, with one policy and one V, whose components all count."""
UNCHECKED = 2
"""The format before checksums and models: read with a warning."""
READ = FORMAT, HITLESS, SWITCHED, CUSPED, UNTURNED, UNVISITED, STEEP, SINGLE


_GONE: Mapping[str, object] = {
    "relative_goals": True,
    "reward_shape": "rational",
    "reward_space": "steps",
}
"""Settings by which an agent sees or counts otherwise than any of today's does."""
_OF_LEARNING = (
    "absorb_power",
    "cooldown",
    "gradient_step",
    "hindsight_steps",
    "imagined_absorb",
    "imagined_targets",
    "relative_goals",
)
"""Fields that are gone, and say nothing of a trained agent."""


def config_of_today(values: Mapping[str, Any], found: int) -> dict[str, Any]:
    """The config of an agent of format `found`. Of what it learned by, a search alone asks.

    Raises:
        EverystateError: it has a setting that is gone, without which it would act otherwise.
    """
    today = dict(values)
    if found > SWITCHED:
        return today
    for name, setting in _GONE.items():
        if today.get(name) == setting:
            raise EverystateError(
                f"it learned with {name} = {setting!r}, which is gone: train it anew, or use the "
                f"everystate that wrote it"
            )
    for name in _OF_LEARNING:
        today.pop(name, None)
    if found <= CUSPED and today.get("reward_shape") == "cusp":
        today["reward_shape"] = "two-slopes"
    if not today.get("imagined_weight"):
        today |= {"imagined_weight": 0.0, "imagined_steps": 0, "value_stride": 0}
    today["kept_steps"] = max(1, today.get("kept_steps", 1))
    return today


def brought_up(
    arrays: Mapping[str, np.ndarray], found: int, state_size: int, octaves: int
) -> dict[str, np.ndarray]:
    """The arrays of an agent of format `found`, as they are named and meant in `FORMAT`.

    Args:
        arrays: by name.
        found: the format they are of.
        state_size: number of components of a state.
        octaves: of the waves in the networks' inputs.
    """
    if found < STEEP:
        arrays = {_renamed(name): x for name, x in arrays.items()}
        arrays["dynamics.weights"] = np.ones(state_size, np.float32)
    if found <= STEEP:
        arrays = {name: _of_steep(name, x, octaves) for name, x in arrays.items()}
    if found <= HITLESS and any(name.startswith("values.1.") for name in arrays):
        arrays = {**arrays, **_half_a_hit(arrays)}
    return dict(arrays)


def _half_a_hit(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A V of hits that says 0.4 of all: where V of passing said less than 0.5, it was held."""
    like = {name: x for name, x in arrays.items() if name.startswith("values.1.")}
    flat = {name.replace(".1.", ".2.", 1): np.zeros_like(x) for name, x in like.items()}
    last = max((name for name in flat if name.endswith(".bias")), key=_layer)
    flat[last][:] = math.log(0.4 / 0.6) - FIRST_LOGIT
    return flat


def _layer(name: str) -> int:
    return int(name.split(".")[-2])


def _renamed(name: str) -> str:
    model, _, rest = name.partition(".")
    model = {"policy": "policies.0", "value": "values.0"}.get(model, model)
    return f"{model}.{rest}"


def _of_steep(name: str, array: np.ndarray, octaves: int) -> np.ndarray:
    """The weights that make of waves of falling amplitude what these made, bit for bit."""
    if not name.endswith("mlp.layers.0.weight"):
        return array
    # x itself, then a sine and a cosine of each octave: see `networks.waves`.
    halvings = np.array([0, *np.repeat(np.arange(octaves), 2)])
    factors = np.repeat(2.0**halvings, array.shape[1] // len(halvings))
    return array * factors.astype(array.dtype)
