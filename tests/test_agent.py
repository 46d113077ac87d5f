"""An agent in its user's hands: units, batches, clear refusals, and the way to disk and back."""

import dataclasses
import json
import shutil
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import safetensors.numpy

import everystate
from everystate import envs
from everystate.agent import (
    Agent,
    BodyInfo,
    config_from_json,
    config_to_json,
    files,
    load,
    loading,
    named_arrays,
    skeleton,
    with_arrays,
)
from everystate.agent.formats import STEEP, brought_up
from everystate.errors import EverystateError
from everystate.hyperparameters import FlowFamily
from everystate.learning.flows import decode
from everystate.learning.models import Scale, Space
from everystate.learning.planning import Planning
from everystate.learning.replay import Transitions
from everystate.presets import PRESETS, preset
from everystate.training.learner import begin
from everystate.viewing.recording import body_of
from small import of_paper

CENTRE = np.array([1.0, -2.0], dtype=np.float32)
SPREAD = np.array([0.5, 4.0], dtype=np.float32)
STATES = np.array([[1.0, -2.0], [1.2, 1.0], [0.4, -5.0]], dtype=np.float32)
GOALS = np.array([[1.5, 2.0], [0.8, -4.0], [1.1, 0.0]], dtype=np.float32)


@pytest.fixture(scope="module")
def agent() -> Agent:
    config = of_paper()
    rng = np.random.default_rng(0)
    shape = (config.warmup_steps, config.num_bodies, 2)
    warmup = Transitions(*(jnp.asarray(rng.normal(size=shape), jnp.float32) for _ in range(4)))
    scale = Scale(jnp.asarray(CENTRE), jnp.asarray(SPREAD))
    body = BodyInfo(("x", "speed"), 2)
    return Agent(begin(config, body.space, warmup, scale).models, scale, config, body)


@pytest.mark.parametrize("plan", [False, True])
def test_batch_and_single_act_alike(agent: Agent, plan: bool) -> None:
    actions = agent.act(STATES, GOALS, plan=plan)
    assert actions.shape == (3, 2)
    assert actions.dtype == np.float32
    assert (np.abs(actions) <= 1).all()
    if not plan:  # with it, every member of a batch gets random candidates of its own
        singles = [agent.act(s, g) for s, g in zip(STATES, GOALS, strict=True)]
        np.testing.assert_allclose(actions, singles, rtol=1e-4, atol=1e-6)
    assert agent.act(STATES[0], GOALS[0], plan=plan).shape == (2,)


def test_act_is_the_policy_at_its_centre(agent: Agent) -> None:
    state, goal = (jnp.asarray((x - CENTRE) / SPREAD) for x in (STATES[1], GOALS[1]))
    expected = np.clip(decode(agent.models.policies[0](state, goal), jnp.zeros(2)), -1, 1)
    np.testing.assert_allclose(agent.act(STATES[1], GOALS[1]), expected, rtol=1e-4, atol=1e-6)


def test_predict_is_the_policys_centre_or_a_draw_from_it(agent: Agent) -> None:
    centre, nothing = agent.predict(STATES, GOALS)
    assert nothing is None
    np.testing.assert_array_equal(centre, agent.act(STATES, GOALS))
    one, again, other = (agent.predict(STATES, GOALS, False, seed=n)[0] for n in (1, 1, 2))
    assert one.shape == (3, 2)
    assert (np.abs(one) <= 1).all()
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)
    assert agent.predict(STATES[0], GOALS[0], deterministic=False)[0].shape == (2,)
    same = agent.predict(np.repeat(STATES[:1], 50, axis=0), GOALS[0], False)[0]
    assert len(np.unique(same, axis=0)) > 10  # each of a batch is drawn on its own
    with pytest.raises(EverystateError, match="nan in speed"):
        agent.predict([1.0, np.nan], GOALS[0], False)


def test_it_says_what_it_is_in_a_line(agent: Agent) -> None:
    said = "Agent(ramp-pointmass: 2 state components, 2 actions, acts with policy)"
    assert repr(agent) == said
    assert agent.state_names == ("x", "speed")
    assert agent.action_names == ("action_0", "action_1")
    assert agent.units == {"x": (1.0, 0.5), "speed": (-2.0, 4.0)}
    assert agent.units["speed"].spread == 4.0
    assert agent.observation_space.contains(STATES[0].astype(np.float32))
    assert agent.observation_space.shape == (2,)
    assert agent.action_space.contains(agent.act(STATES[0], GOALS[0]))
    assert not agent.action_space.contains(np.array([1.1, 0.0], np.float32))


@pytest.mark.parametrize("name", envs.BODIES)
def test_shipped_agents_know_the_names_of_their_actions(name: str) -> None:
    shipped, env = load(name), envs.make(name, 1, 0)
    assert shipped.action_names == env.action_names
    assert shipped.body.action_names == env.action_names


def test_one_goal_serves_many_states(agent: Agent) -> None:
    repeated = np.repeat(GOALS[:1], 3, axis=0)
    np.testing.assert_array_equal(agent.act(STATES, GOALS[0]), agent.act(STATES, repeated))


def test_a_plan_begins_with_the_action_and_leads_from_the_state(agent: Agent) -> None:
    plan = agent.plan(STATES, GOALS, seed=1)
    np.testing.assert_array_equal(plan.actions[:, 0], agent.act(STATES, GOALS, plan=True, seed=1))
    assert plan.actions.shape == (len(STATES), 8, 2)
    assert plan.states.shape == (len(STATES), 9, 2)
    np.testing.assert_allclose(plan.states[:, 0], STATES, atol=1e-5)
    one = agent.plan(STATES[0], GOALS[0], planning=Planning(horizon=3))
    assert one.actions.shape == (3, 2)
    assert one.states.shape == (4, 2)


def test_planning_depends_on_nothing_but_the_seed(agent: Agent) -> None:
    first, again = (agent.act(STATES, GOALS, plan=True, seed=1) for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_where_a_plan_corrects_nothing_the_policy_acts(agent: Agent) -> None:
    plan = agent.plan(STATES, GOALS, seed=1)
    assert plan.corrected.shape == plan.gain.shape == (len(STATES),)
    alone = agent.act(STATES, GOALS)[~plan.corrected]
    np.testing.assert_allclose(plan.actions[~plan.corrected, 0], alone, atol=1e-6)


def test_steps_to_goal_is_minus_the_value(agent: Agent) -> None:
    state, goal = (jnp.asarray((x - CENTRE) / SPREAD) for x in (STATES[2], GOALS[2]))
    steps = agent.steps_to_goal(STATES, GOALS)
    assert steps.shape == (3,)
    np.testing.assert_allclose(steps[2], -agent.models.values[0](state, goal), rtol=1e-4)
    np.testing.assert_allclose(agent.steps_to_goal(STATES[2], GOALS[2]), steps[2], rtol=1e-4)


def test_density_integrates_to_one_in_the_units_of_the_body(agent: Agent) -> None:
    x, speed = (
        np.linspace(c - 12 * s, c + 12 * s, 300) for c, s in zip(CENTRE, SPREAD, strict=True)
    )
    grid = np.stack(np.meshgrid(x, speed), axis=-1).reshape(-1, 2)
    cell = (x[1] - x[0]) * (speed[1] - speed[0])
    assert np.exp(agent.log_density(grid)).sum() * cell == pytest.approx(1, abs=0.01)
    assert agent.log_density(grid[0]).shape == ()


def test_goals_are_the_least_likely_of_what_it_imagines(agent: Agent) -> None:
    goals = agent.propose_goals(200)
    assert goals.shape == (200, 2)
    np.testing.assert_array_equal(goals[:3], agent.propose_goals(200)[:3])
    assert not np.array_equal(goals[:3], agent.propose_goals(3, seed=1))
    single = dataclasses.replace(agent, config=dataclasses.replace(agent.config, m=1))
    assert agent.log_density(goals).mean() < agent.log_density(single.propose_goals(200)).mean() - 1


@pytest.mark.parametrize(
    ("observation", "goal", "named"),
    [
        ([1.0], GOALS[0], "x, speed"),
        (STATES[0], [[[1.0, 2.0]]], r"\(1, 1, 2\)"),
        ([1.0, np.nan], GOALS[0], "nan in speed"),
        (STATES, [[0.0, 0.0], [np.inf, 0.0], [0.0, 0.0]], "inf in x"),
        (STATES, GOALS[:2], "3 observations and 2 goals"),
        (["a", "b"], GOALS[0], "no array of numbers"),
    ],
)
def test_what_is_no_state_is_refused(agent: Agent, observation, goal, named: str) -> None:
    for method in (agent.act, agent.steps_to_goal):
        with pytest.raises(EverystateError, match=named):
            method(observation, goal)


def test_no_goals_are_refused(agent: Agent) -> None:
    with pytest.raises(EverystateError, match="n is 0"):
        agent.propose_goals(0)


def test_an_exported_agent_is_the_same_agent(agent: Agent, tmp_path: Path) -> None:
    folder = agent.export(tmp_path / "deep" / "mine", scores={"floor": 0.5})
    assert sorted(path.name for path in folder.iterdir()) == ["agent.json", "agent.safetensors"]
    assert json.loads((folder / "agent.json").read_text())["scores"] == {"floor": 0.5}
    loaded = load(folder)
    assert (loaded.config, loaded.body) == (agent.config, agent.body)
    for (name, mine), theirs in zip(
        named_arrays((agent.models, agent.scale)).items(),
        named_arrays((loaded.models, loaded.scale)).values(),
        strict=True,
    ):
        assert np.array_equal(mine, theirs), name
    np.testing.assert_array_equal(loaded.act(STATES, GOALS), agent.act(STATES, GOALS))


def test_what_drives_an_agent_best_travels_with_it(agent: Agent, tmp_path: Path) -> None:
    said = dataclasses.replace(agent, act_with="plan").export(tmp_path / "plans") / "agent.json"
    assert load(said.parent).act_with == "plan"
    told = json.loads(said.read_text())
    for value, expected in ((None, "policy"), ("wish", "act_with is 'wish': expected policy or")):
        changed = {n: x for n, x in (told | {"act_with": value}).items() if x is not None}
        changed["checksum"] = files._own_checksum(changed)
        said.write_text(json.dumps(changed))
        if value is None:
            assert load(said.parent).act_with == expected
        else:
            with pytest.raises(EverystateError, match=expected):
                load(said.parent)


@pytest.mark.parametrize("name", envs.BODIES)
def test_shipped_agents_act_by_what_does_more_of_their_skills(name: str) -> None:
    scores = json.loads((loading.SHIPPED / name / "agent.json").read_text())["scores"]
    policy, planning = scores["skills"]["policy"], scores["skills"]["planning"]
    planned = sum(planning.values()) if planning else 0.0
    expected = "plan" if planned > sum(policy.values()) else "policy"
    assert load(name).act_with == expected


def test_export_overwrites_nothing(agent: Agent, tmp_path: Path) -> None:
    (tmp_path / "note").write_text("mine")
    with pytest.raises(EverystateError, match="exists already"):
        agent.export(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["note"]


@pytest.mark.parametrize("damage", ["truncate", "other shapes", "format", "no weights", "field"])
def test_damaged_agents_are_named(agent: Agent, tmp_path: Path, damage: str) -> None:
    folder = agent.export(tmp_path / "agent")
    weights, description = folder / "agent.safetensors", folder / "agent.json"
    told = json.loads(description.read_text())
    if damage == "truncate":
        weights.write_bytes(weights.read_bytes()[:-100])
    elif damage == "other shapes":
        told["config"]["width"] += 1
    elif damage == "format":
        told["format"] = 99
    elif damage == "no weights":
        weights.unlink()
    elif damage == "field":
        told["config"]["hidden"] = 1
    description.write_text(json.dumps(told))
    with pytest.raises(EverystateError, match=r"format 99|'hidden'|damaged"):
        load(folder)


@pytest.mark.parametrize("name", ["agent.json", "agent.safetensors"])
def test_a_flipped_bit_is_an_error(agent: Agent, tmp_path: Path, name: str) -> None:
    path = agent.export(tmp_path / "agent", {"note": "at 0.5"}) / name
    sound, rng = path.read_bytes(), np.random.default_rng(0)
    places = [*range(100), *rng.integers(len(sound), size=400).tolist()]  # the head, and anywhere
    noticed = 0
    for at in places:
        flipped = bytearray(sound)
        flipped[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(flipped)
        try:
            load(path.parent)
        except EverystateError:
            noticed += 1
        else:  # a blank for another between values
            assert json.loads(flipped) == json.loads(sound), at
    assert noticed >= (450 if name == "agent.json" else 500)


def test_one_agents_arrays_are_not_anothers(agent: Agent, tmp_path: Path) -> None:
    one = agent.export(tmp_path / "one")
    models = jax.tree.map(lambda x: x + 1 if eqx.is_inexact_array(x) else x, agent.models)
    other = dataclasses.replace(agent, models=models).export(tmp_path / "other")
    shutil.copy(other / "agent.safetensors", one)
    with pytest.raises(EverystateError, match=r"one/agent.safetensors has another checksum"):
        load(one)


def test_an_agent_of_the_format_before_checksums_is_read_with_a_warning(
    agent: Agent, tmp_path: Path
) -> None:
    folder = agent.export(tmp_path / "old")
    told = json.loads((folder / "agent.json").read_text())
    del told["checksum"], told["files"], told["body"]["model_hash"], told["body"]["versions"]
    (folder / "agent.json").write_text(json.dumps(told | {"format": 2}))
    arrays = safetensors.numpy.load_file(folder / "agent.safetensors")
    for name, x in arrays.items():
        factors = brought_up({name: np.ones_like(x)}, STEEP, 2, agent.config.frequencies)[name]
        if (factors > 1).any():
            arrays[name] = x.astype(np.float32) / factors
    safetensors.numpy.save_file(arrays, folder / "agent.safetensors")
    with pytest.warns(UserWarning, match=r"format 2, without checksums.*Export it anew"):
        old = load(folder)
    np.testing.assert_array_equal(old.act(STATES, GOALS), agent.act(STATES, GOALS))
    load(old.export(tmp_path / "new"))
    # With a checksum it is none of that format, whatever it says.
    told = json.loads((tmp_path / "new" / "agent.json").read_text())
    (tmp_path / "new" / "agent.json").write_text(json.dumps(told | {"format": 2}))
    with pytest.raises(EverystateError, match="has format 2 and this"):
        load(tmp_path / "new")


@pytest.mark.parametrize("name", envs.BODIES)
def test_shipped_agents_learned_on_the_bodies_of_today(name: str) -> None:
    shipped = load(name)
    assert shipped.body.model_hash == envs.make(name, 1, 0).model_hash
    assert body_of(shipped).name == name  # without a warning
    other = dataclasses.replace(shipped, body=shipped.body._replace(model_hash="0" * 64))
    with pytest.warns(UserWarning, match=f"{name} is another model than the agent learned on"):
        body_of(other)


def test_shipped_agents_load_by_name(
    agent: Agent, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    agent.export(tmp_path / "shipped" / "ramp")
    monkeypatch.setattr(loading, "SHIPPED", tmp_path / "shipped")
    monkeypatch.chdir(tmp_path)
    assert load("ramp").config == agent.config
    with pytest.raises(EverystateError, match="did you mean 'ramp'"):
        load("rampp")
    with pytest.raises(EverystateError, match="holds no agent"):
        load(tmp_path)


def test_every_config_survives_json() -> None:
    for name in PRESETS:
        config = preset(name)
        assert config_from_json(json.loads(json.dumps(config_to_json(config)))) == config


def test_the_public_names_are_there() -> None:
    for name in everystate.__all__:
        assert getattr(everystate, name).__name__.rpartition(".")[2] == name
        assert everystate.__getattr__(name) is getattr(everystate, name)  # if never used before
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = everystate.nothing


@pytest.mark.parametrize("flow", ["pldu", "coupling-affine"])
def test_no_flow_remembers_a_trace(flow: FlowFamily) -> None:
    """What a new run makes, and what is read from files, must work outside of what made it."""
    config = preset("test", flow=flow)
    steps = jnp.zeros((config.warmup_steps, config.num_bodies, 2))
    space, scale = Space(2, 2), Scale(jnp.zeros(2), jnp.ones(2))
    state = begin(config, space, Transitions(steps, steps, steps, steps), scale)
    read = with_arrays(skeleton(config, space), named_arrays(state))
    for models in (state.models, read.models):
        assert jnp.isfinite(models.state_flow.log_prob(jnp.zeros(2)))
        assert jnp.isfinite(models.policies[0](jnp.zeros(2), jnp.ones(2)).log_prob(jnp.zeros(2)))
