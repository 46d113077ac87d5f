"""An exported policy is the agent's own, in NumPy and in ONNX Runtime; a damaged one is named."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import onnx
import onnxruntime
import pytest

from everystate import cli, envs, portable
from everystate.agent import Agent, BodyInfo, load
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.learning.models import Scale, Space, new_models
from everystate.learning.objectives import pursued
from everystate.presets import preset
from small import of_paper

NAMES = "x", "y", "speed"
CENTRE, SPREAD = np.array([1.0, -2.0, 0.0]), np.array([0.5, 4.0, 1.0])
PAPER = of_paper(flow_shift=True, frequencies=3)
QUICK = preset("test")
LATENT = dataclasses.replace(QUICK, reward_shape="exponential", reward_space="latent")
CONFIGS = {
    "the paper's": of_paper(alternate=False),
    "four layers": dataclasses.replace(PAPER, policy_layers=4),
    "five layers": dataclasses.replace(PAPER, policy_layers=5, both_goals=True),
    "hold and pass": QUICK,
    "without centres": dataclasses.replace(QUICK, centres=False),
    "in latent space": dataclasses.replace(LATENT, kernel_width=0.0, k=0.3),
    "unlike h": dataclasses.replace(LATENT, alternate=False, kernel_width=1.0),
    "another flow": dataclasses.replace(QUICK, flow="coupling-affine"),
}


def agent_of(config: Config) -> Agent:
    """One that learned nothing, but whose every number is its own; y counts for nothing."""
    rng, key = np.random.default_rng(0), jax.random.key(0)
    models = new_models(config, Space(3, 2), jnp.array([0.5, 1.0, 2.0]), key=key)

    def stirred(x: Any) -> Any:
        return x + 0.15 * rng.normal(size=x.shape).astype(np.float32)

    models = jax.tree.map(lambda x: stirred(x) if eqx.is_inexact_array(x) else x, models)
    weights = jnp.array([1.0, 0.0, 0.5])
    models = eqx.tree_at(lambda m: m.dynamics.weights, models, weights)
    if len(models.values) > 1:  # about half of the goals can be held
        place, steep = (lambda m: m.values[0].network.mlp.layers[-1]), 20.0
        last = place(models)
        models = eqx.tree_at(lambda m: place(m).weight, models, steep * last.weight)
        models = eqx.tree_at(lambda m: place(m).bias, models, jnp.array([-5.0]))
    scale = Scale(*(jnp.asarray(x, jnp.float32) for x in (CENTRE, SPREAD)))
    return Agent(models, scale, config, BodyInfo(NAMES, 2))


def states_of(agent: Agent, count: int) -> np.ndarray:
    """Pairs of a state and a goal [2, count, state], half of them near each other."""
    rng = np.random.default_rng(1)
    centre, spread = np.array(list(agent.units.values())).T
    apart = np.geomspace(0.01, 3, count)[:, None]
    scaled = rng.normal(size=(2, count, len(centre)))
    scaled[1] = scaled[0] + apart * scaled[1]
    return (centre + spread * scaled).astype(np.float32)


def by_onnx(path: Path, states: np.ndarray, goals: np.ndarray) -> np.ndarray:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(path, options)
    (action,) = session.run(["action"], {"observation": states, "goal": goals})
    return np.asarray(action)


@pytest.mark.parametrize("name", [*CONFIGS, *envs.BODIES])
def test_a_policy_acts_as_its_agent_does(name: str, tmp_path: Path) -> None:
    agent = agent_of(CONFIGS[name]) if name in CONFIGS else load(name)
    states, goals = states_of(agent, 500)
    expected = agent.act(states, goals)
    assert (np.abs(expected) < 1).mean() > 0.2
    if len(agent.models.policies) > 1:
        scaled = [agent.scale.scaled(jnp.asarray(x)) for x in (states, goals)]
        kinds = jax.vmap(lambda s, g: pursued(agent.config, agent.models, s, g))(*scaled)
        assert 0 < kinds.mean() < 1  # some goals are held, some passed
    policy = portable.load(agent.export(tmp_path / "policy.npz"))
    assert (policy.state_names, policy.action_names) == (agent.state_names, agent.action_names)
    np.testing.assert_allclose(policy.act(states, goals), expected, rtol=0, atol=1e-5)
    path = agent.export(tmp_path / "policy.onnx")
    np.testing.assert_allclose(by_onnx(path, states, goals), expected, rtol=0, atol=1e-5)
    one = by_onnx(path, states[:1], goals[:1])
    np.testing.assert_allclose(one, expected[:1], rtol=0, atol=1e-5)


def test_it_takes_single_states_and_batches(tmp_path: Path) -> None:
    agent = agent_of(PAPER)
    policy = portable.load(agent.export(tmp_path / "policy.npz"))
    states, goals = states_of(agent, 4)
    each = [policy.act(s, goals[0]) for s in states]
    assert each[0].shape == (2,)
    assert each[0].dtype == np.float32
    np.testing.assert_allclose(policy.act(states, goals[0]), each, atol=1e-6)
    np.testing.assert_allclose(policy.act(states[0], goals), agent.act(states[0], goals), atol=1e-5)
    for shape in ((2,), (4, 2), (1, 1, 3)):
        with pytest.raises(EverystateError, match=r"the goal has shape .* for x, y, speed"):
            policy.act(states[0], np.zeros(shape))


def test_an_onnx_file_says_what_it_is(tmp_path: Path) -> None:
    model = onnx.load(load("cartpole").export(tmp_path / "deep" / "policy.onnx"))
    shapes = {
        value.name: [dim.dim_param or dim.dim_value for dim in value.type.tensor_type.shape.dim]
        for value in (*model.graph.input, *model.graph.output)
    }
    assert shapes == {"observation": ["batch", 5], "goal": ["batch", 5], "action": ["batch", 1]}
    told = {prop.key: json.loads(prop.value) for prop in model.metadata_props}
    assert told["state_names"] == list(load("cartpole").state_names)
    assert told["action_names"] == list(load("cartpole").action_names)


def test_it_runs_where_jax_is_not_imported(tmp_path: Path) -> None:
    agent = load("cartpole")
    path, states = agent.export(tmp_path / "policy.npz"), states_of(agent, 3)
    script = f"""
import json, sys
from everystate import portable
print(json.dumps(portable.load({str(path)!r}).act(*{states.tolist()}).tolist()))
assert not {{"jax", "equinox", "onnx", "mujoco"}} & set(sys.modules)
"""
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    np.testing.assert_allclose(json.loads(said.stdout), agent.act(*states), atol=1e-5)


@pytest.mark.parametrize("ending", ["npz", "onnx"])
def test_nothing_is_overwritten_and_nothing_left_out_unsaid(ending: str, tmp_path: Path) -> None:
    agent, path = agent_of(PAPER), tmp_path / f"policy.{ending}"
    path.write_text("mine")
    with pytest.raises(EverystateError, match="exists already"):
        agent.export(path)
    assert path.read_text() == "mine"
    path.unlink()
    with pytest.raises(EverystateError, match="leave out scores and half"):
        agent.export(path, half=True)
    with pytest.raises(EverystateError, match="leave out scores and half"):
        agent.export(path, {"rest": 1.0})
    (tmp_path / "file").touch()
    with pytest.raises(EverystateError, match="cannot export to"):
        agent.export(tmp_path / "file" / path.name)
    assert [one.name for one in tmp_path.iterdir()] == ["file"]
    with pytest.raises(EverystateError, match=r"policy alone: everystate\.portable\.load"):
        load(agent.export(path))


@pytest.mark.parametrize(
    ("ending", "meant"), [(".onx", ".onnx"), (".ONNX", ".onnx"), (".npy", ".npz")]
)
def test_a_misspelt_ending_is_no_folder(ending: str, meant: str, tmp_path: Path) -> None:
    with pytest.raises(EverystateError, match=f"ends in {ending}: did you mean {meant}"):
        agent_of(PAPER).export(tmp_path / f"policy{ending}")
    assert not list(tmp_path.iterdir())
    assert agent_of(PAPER).export(tmp_path / "policy.v2").is_dir()


@pytest.mark.parametrize(
    "changes",
    [{"centres": False}, {"reward_space": "latent", "reward_shape": "exponential"}],
)
def test_what_has_no_steps_is_refused(changes: dict[str, Any], tmp_path: Path) -> None:
    agent = agent_of(dataclasses.replace(CONFIGS["another flow"], **changes))
    with pytest.raises(EverystateError, match=r"coupling-affine.*folder or NAME\.zip"):
        agent.export(tmp_path / "policy.npz")
    assert not list(tmp_path.iterdir())


def test_without_onnx_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(EverystateError, match=r"pip install 'everystate\[onnx\]', or .* NAME.npz"):
        agent_of(PAPER).export(tmp_path / "policy.onnx")
    assert not list(tmp_path.iterdir())


def test_the_command_writes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("policy.npz", "policy.onnx"):
        assert cli.main(["export", "ramp-pointmass", name]) == 0
        assert Path(name).is_file()
    assert capsys.readouterr().out.split() == ["policy.npz", "policy.onnx"]
    assert cli.main(["export", "ramp-pointmass", "half.onnx", "--half"]) == 2
    assert "leave out scores and half" in capsys.readouterr().err


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    whole = agent_of(PAPER).export(tmp_path / "policy.npz").read_bytes()
    other = tmp_path / "other.npz"
    for content in (b"", b"no archive", whole[: len(whole) // 2]):
        other.write_bytes(content)
        with pytest.raises(EverystateError, match=r"other\.npz holds no policy"):
            portable.load(other)
    with pytest.raises(EverystateError, match=r"gone\.npz holds no policy"):
        portable.load(tmp_path / "gone.npz")
    with np.load(tmp_path / "policy.npz") as file:
        arrays = dict(file)
    told = json.loads(str(arrays["policy"]))
    strange = [["Evil", ["goal"], "action"]], [["Exp", ["nothing"], "action"]]
    for changes, said in (
        ({"format": 9}, "has format 9 and this everystate reads format 1"),
        *(({"steps": steps}, "holds no policy") for steps in strange),
    ):
        changed: dict[str, Any] = arrays | {"policy": np.array(json.dumps(told | changes))}
        np.savez(other, **changed)
        with pytest.raises(EverystateError, match=said):
            portable.load(other)
    np.savez(other, policy=np.array({"a": "pickle"}))
    with pytest.raises(EverystateError, match="holds no policy"):
        portable.load(other)
