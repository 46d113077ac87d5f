"""Agents of older formats do what they did."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from everystate.agent import config_from_json
from everystate.agent.formats import (
    CUSPED,
    FORMAT,
    HITLESS,
    STEEP,
    SWITCHED,
    brought_up,
    config_of_today,
)
from everystate.errors import EverystateError
from everystate.learning.networks import Network
from everystate.learning.objectives import FIRST_LOGIT

NAME = "values.0.network.mlp.layers.0.weight"


def test_weights_for_waves_of_one_amplitude_become_those_for_falling_ones() -> None:
    octaves, size = 3, 2
    network = Network(size, 1, width=8, depth=1, frequencies=octaves, key=jax.random.key(0))
    old = np.asarray(network.mlp.layers[0].weight)
    new = brought_up({NAME: old}, STEEP, size, octaves)[NAME]
    x = jnp.array([0.3, -1.2])
    steep = [w(2.0**o * jnp.pi / 2 * x) for o in range(octaves) for w in (jnp.sin, jnp.cos)]
    waves = network.inputs(x)
    np.testing.assert_allclose(new @ waves, old @ jnp.concatenate([x, *steep]), rtol=1e-5)


def test_no_other_array_is_touched() -> None:
    name, other = "values.0.network.mlp.layers.1.weight", np.ones((3, 7), np.float32)
    np.testing.assert_array_equal(brought_up({name: other}, STEEP, 2, 3)[name], other)


def test_an_agent_that_held_goals_by_a_cusp_alone_is_one_of_two_slopes() -> None:
    cusped = {"reward_shape": "cusp", "seed": 3}
    assert config_of_today(cusped, CUSPED)["reward_shape"] == "two-slopes"
    assert config_of_today(cusped, FORMAT) == cusped


def test_an_agent_without_hits_of_what_holds_passes_what_it_hits_by_a_half() -> None:
    """As it did: its third V says 0.8 of that half, everywhere."""
    layers = [f"network.mlp.layers.{i}.{x}" for i in (0, 10) for x in ("weight", "bias")]
    old = {f"values.{i}.{name}": np.ones(3, np.float32) for i in (0, 1) for name in layers}
    new = brought_up(old, HITLESS, 2, 3)
    assert new.keys() - old.keys() == {f"values.2.{name}" for name in layers}
    for name in layers:
        says = np.log(0.4 / 0.6) - FIRST_LOGIT if name == layers[-1] else 0
        np.testing.assert_allclose(new[f"values.2.{name}"], says, rtol=1e-6)
    assert brought_up(old, FORMAT, 2, 3).keys() == old.keys()


@pytest.mark.parametrize(
    "fields",
    [
        {"imagined_weight": 0.0, "imagined_steps": 5, "kept_steps": 0, "imagined_targets": 0.0},
        {"imagined_weight": 50.0, "imagined_steps": 16, "kept_steps": 8, "imagined_targets": 1.0},
    ],
)
def test_what_an_agent_no_longer_has_to_know_is_left_out(fields) -> None:
    """And what is left is a config."""
    gone = {"cooldown": 0.4, "absorb_power": 6, "hindsight_steps": 1, "relative_goals": False}
    config = config_from_json(config_of_today(fields | gone | {"seed": 3}, SWITCHED))
    assert config.seed == 3
    assert config.imagined_steps == (16 if fields["imagined_weight"] else 0)
    assert config.kept_steps == max(1, fields["kept_steps"])


@pytest.mark.parametrize(
    ("name", "setting"),
    [("relative_goals", True), ("reward_shape", "rational"), ("reward_space", "steps")],
)
def test_an_agent_that_would_act_otherwise_is_refused(name, setting) -> None:
    with pytest.raises(EverystateError, match=f"{name} = .*is gone: train it anew"):
        config_of_today({name: setting}, SWITCHED)
