"""Presets and fields: the paper's numbers, and errors that say what to change."""

import math
from dataclasses import asdict, fields
from typing import get_type_hints

import pytest

from everystate import limits
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.presets import PRESETS, preset

BODIES = ("ramp-pointmass", "cartpole", "ant")
STABILISERS = {
    "weight_temper",
    "weight_clip",
    "patience",
    "state_noise",
    "dynamics_noise",
    "action_noise",
    "bound_value",
    "normalise_curriculum",
    "gradient_clip",
    "max_gradient_step",
}


@pytest.mark.parametrize("body", [*BODIES, "gymnasium:Pendulum-v1"])
def test_every_preset_is_valid_for_every_body(body):
    assert {"quick", "paper", "literal", "test"} <= set(PRESETS)
    for name in PRESETS:
        config = preset(name, body, seed=3)
        assert (config.body, config.seed) == (body, 3)
        assert preset(name, body, seed=3) == config
        assert hash(config) == hash(preset(name, body, seed=3))  # jit takes it as static.


@pytest.mark.parametrize("name", ["quick", "test"])
def test_one_set_of_numbers_serves_any_body(name):
    """It looks up no name: nothing but the body differs."""
    bodies = (*BODIES, "arm.xml", "gymnasium:Ant-v5", "shimmy:dm_control/finger-spin-v0")
    sets = [asdict(preset(name, body)) | {"body": ""} for body in bodies]
    assert all(numbers == sets[0] for numbers in sets)


@pytest.mark.parametrize("name", ["paper", "literal"])
@pytest.mark.parametrize(
    ("body", "h", "k"), [("ramp-pointmass", 20, 100), ("cartpole", 20, 10), ("ant", 50, 10)]
)
def test_the_papers_presets_have_the_numbers_of_appendix_b(name, body, h, k):
    config = preset(name, body)
    assert (config.half_life, config.k) == (h, k)
    expected = {
        "m": 20,
        "p_curric": 0.8,
        "j": 1,
        "N": 20,
        "batch_size": 1000,
        "num_updates": 100,
        "num_bodies": 50,
        "depth": 4,
        "width": 200,
        "learning_rate": 1e-3,
        "state_layers": 20,
        "dynamics_layers": 2,
        "policy_layers": 2,
        "curriculum_layers": 20,
    }
    assert {field: getattr(config, field) for field in expected} == expected
    # What the paper's text says without a number.
    assert (config.pessimism, config.percentile) == ("percentile", 0)
    assert config.target_period == config.num_updates
    assert config.reward_space == "latent"
    assert config.flow == "pldu"
    assert not config.flow_shift
    assert (config.absorb, config.discount, config.approach_share) == (0, 1, 0)
    assert config.frequencies == 0
    assert config.sensor_noise == 0
    assert config.imagined_steps == 0


@pytest.mark.parametrize("body", BODIES)
def test_literal_is_paper_without_its_stabilisers(body):
    paper, literal = asdict(preset("paper", body)), asdict(preset("literal", body))
    assert {field for field in paper if paper[field] != literal[field]} == STABILISERS
    off = {"weight_temper": 1, "patience": 1, "bound_value": False, "normalise_curriculum": False}
    off |= dict.fromkeys(("weight_clip", "gradient_clip", "max_gradient_step"), math.inf)
    off |= dict.fromkeys(("state_noise", "dynamics_noise", "action_noise"), 0)
    assert {field: literal[field] for field in STABILISERS} == off


def test_every_number_has_a_range():
    numbers = {field.name for field in fields(Config) if field.type in (int, float)}
    assert numbers == set(limits.RANGES)


@pytest.mark.parametrize("field", limits.RANGES)
def test_a_number_out_of_range_is_named_with_its_range(field):
    low, high = limits.RANGES[field]
    number = type(getattr(Config(), field))
    bad = [number(math.floor(low) - 1)]
    bad += [number(high + 1)] if math.isfinite(high) else []
    bad += [math.nan] if number is float else []
    for value in bad:
        with pytest.raises(EverystateError) as error:
            preset("test", **{field: value})
        message = str(error.value)
        assert message.startswith(f"{field} = {value} ")
        assert f"[{low:g}, {high:g}]" in message
        assert "\n" not in message


def test_sizes_that_do_not_fit_each_other_are_named():
    with pytest.raises(EverystateError, match=r"target_period = 7 .*num_updates = 10"):
        preset("test", target_period=7)
    with pytest.raises(EverystateError, match=r"capacity = 4001 .*num_bodies = 10"):
        preset("test", capacity=4001)
    with pytest.raises(EverystateError, match=r"capacity = 390 .*400 items.*raise capacity"):
        preset("test", capacity=390)
    assert preset("test", capacity=400).capacity == 400


def test_pairs_without_candidates_must_have_imagined_targets():
    with pytest.raises(EverystateError, match=r"improved_share = 0\.5 .*imagined_steps = 0"):
        preset("paper", improved_share=0.5)
    assert preset("paper").improved_pairs == 1000
    config = preset("test", improved_share=0.25, batch_size=32)
    assert config.improved_pairs == 8
    with pytest.raises(EverystateError, match=r"devices = 16 .* 8 pairs .*improved_share"):
        preset("test", improved_share=0.25, batch_size=32, devices=16)


def test_a_hit_is_counted_on_whole_ways_alone():
    with pytest.raises(EverystateError, match=r"'hold-and-pass' .*imagined_steps = 0 .*raise it"):
        preset("paper", objective="hold-and-pass")


def test_two_slopes_say_where_they_count_themselves():
    with pytest.raises(EverystateError, match=r"reward_space = 'latent' .*set reward_space to"):
        preset("quick", reward_space="latent")


def test_v_learns_on_imagined_ways_only_where_there_are_some():
    with pytest.raises(EverystateError, match=r"value_stride = 4 .*imagined_steps = 0 "):
        preset("paper", value_stride=4)
    assert preset("paper", value_stride=4, imagined_steps=8).value_stride == 4


def test_unknown_names_suggest_the_nearest():
    with pytest.raises(EverystateError, match="unknown preset 'papr': did you mean 'paper'"):
        preset("papr")
    with pytest.raises(EverystateError, match="unknown field 'batchsize': did you mean 'batch_siz"):
        preset("test", batchsize=10)
    with pytest.raises(EverystateError) as error:
        preset("zzz")
    assert all(name in str(error.value) for name in PRESETS)


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("pessimism", "men", "did you mean 'mean'"),
        ("flow", "nothing", "choose one of"),
        ("m", 2.5, "int"),
        ("m", "20", "int"),
        ("bound_value", "no", "bool"),
        ("k", None, "float"),
    ],
)
def test_values_of_the_wrong_kind_are_refused(field: str, value: object, says: str):
    # By hand: under pytest, beartype would refuse the constructor's argument before we do.
    kind = get_type_hints(Config)[field]
    with pytest.raises(EverystateError, match=says) as error:
        limits.require_kind(field, value, kind)
    assert field in str(error.value)
