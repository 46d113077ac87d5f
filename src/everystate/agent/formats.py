"""Formats of exported agents, and what makes of an older one one of today's."""

from collections.abc import Mapping
from typing import Any

import numpy as np

FORMAT = 8
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
READ = FORMAT, CUSPED, UNTURNED, UNVISITED, STEEP, SINGLE


def config_of_today(values: Mapping[str, Any], found: int) -> dict[str, Any]:
    """The config of an agent of format `found`. Of what it learned by, a search alone asks."""
    cusped = found <= CUSPED and values.get("reward_shape") == "cusp"
    return dict(values) | ({"reward_shape": "two-slopes"} if cusped else {})


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
    return dict(arrays)


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
