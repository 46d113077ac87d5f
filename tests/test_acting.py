"""What is kept of a scored agent acts as it did, and nothing else is taken for it."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from everystate import load
from everystate.errors import EverystateError
from everystate.evaluation import suites
from everystate.peers import acting
from everystate.peers.acting import Actor
from everystate.peers.agents import PeerConfig
from everystate.peers.settings import SETTINGS
from everystate.studies import Terms
from everystate.studies.timed import Rescoring, Timed

TERMS = Terms("ramp-pointmass", minutes=1.0, preset="test", episodes=20, plan=False)
TYPED = {"command": "everystate compare", "argv": ["everystate", "compare"]}
GOALS = suites.load("ramp-pointmass").goals
STARTS = GOALS[::-1]


def made(*hidden: int) -> Actor:
    """Untrained, but with weights large enough for actions of all sizes."""
    rng = np.random.default_rng(0)
    sizes = [6, *hidden, 2]
    shapes = list(zip(sizes[1:], sizes[:-1], strict=True))
    weights = [rng.normal(0, (2 / n) ** 0.5, (m, n)).astype(np.float32) for m, n in shapes]
    return Actor(
        config=PeerConfig("ramp-pointmass", (), 0, "sac-her", asdict(SETTINGS["sac-her"])),
        inputs=("achieved_goal", "desired_goal", "observation"),
        shift=np.full(6, 0.1, np.float32),
        scale=np.full(6, 2.0, np.float32),
        clip=10.0,
        weights=tuple(weights),
        biases=tuple(rng.normal(0, 0.1, n).astype(np.float32) for n in sizes[1:]),
    )


def test_an_actor_acts_the_same_after_it_was_kept(tmp_path: Path) -> None:
    actor = made(256, 256, 256)  # as the mixture has it
    acting.write(actor, tmp_path / "acting")
    kept = acting.read(tmp_path / "acting")
    assert kept.config == replace(actor.config, settings=kept.config.settings)
    assert kept.config.settings == json.loads(json.dumps(actor.config.settings))
    before, after = (a.act(STARTS, GOALS) for a in (actor, kept))
    assert before.shape == GOALS[:, :2].shape
    assert np.abs(before).mean() > 0.1
    assert 0 < np.abs(before - after).max() < 0.02
    # Inputs go where the network has them, a single state is as good as a batch.
    swapped = actor.act(GOALS, STARTS)
    assert np.abs(swapped - before).max() > 0.1
    np.testing.assert_allclose(actor.act(STARTS[3], GOALS[3]), before[3], atol=1e-5)
    assert (tmp_path / "acting/actor.safetensors").stat().st_size < 300_000


def test_our_agent_acts_the_same_with_matrices_of_float16(tmp_path: Path) -> None:
    agent = load("ramp-pointmass")
    whole = load(agent.export(tmp_path / "whole"))
    half = load(agent.export(tmp_path / "half", half=True))
    before, same, after = (a.act(STARTS, GOALS) for a in (agent, whole, half))
    np.testing.assert_array_equal(before, same)
    assert 0 < np.abs(before - after).max() < 0.01
    files = [tmp_path / name / "agent.safetensors" for name in ("half", "whole")]
    assert files[0].stat().st_size < 0.6 * files[1].stat().st_size


def test_what_was_kept_is_measured_again(tmp_path: Path) -> None:
    """Of an agent that nothing here trained: no PyTorch is needed."""
    kept = tmp_path / "acting"
    acting.write(made(32), kept)
    before = {"steps": 7, "coverage": None, "acting": acting.checksums(kept), "metrics": "0" * 64}
    (tmp_path / "evaluation.json").write_text(json.dumps(before))
    Rescoring(Timed("sac-her", 0, TERMS))(tmp_path, TYPED)
    found = json.loads((tmp_path / "rescored.json").read_text())
    assert found["agent"] == found["config"]["agent"] == "sac-her"
    assert found["config"]["settings"]["source"] == SETTINGS["sac-her"].source
    assert found["steps"] == 7
    assert found["suites"]["rest"]["policy"]["calibration"]["mae"] is None  # no critic was kept
    file = kept / "actor.safetensors"
    file.write_bytes(file.read_bytes()[:-1] + b"!")
    with pytest.raises(EverystateError, match="is not what"):
        Rescoring(Timed("sac-her", 0, TERMS))(tmp_path, TYPED)


def test_our_agent_is_measured_as_it_is_kept(tmp_path: Path) -> None:
    """Of a run whose time is over: nothing is left to train."""
    run = load("ramp-pointmass").export(tmp_path / "run")
    line = {"epoch": 1, "steps": 500, "time/elapsed_s": 60.0}
    (run / "metrics.jsonl").write_text(json.dumps(line) + "\n")
    Timed("ours", 0, TERMS)(tmp_path, TYPED)
    Rescoring(Timed("ours", 0, TERMS))(tmp_path, TYPED)
    names = "evaluation.json", "rescored.json"
    first, again = (json.loads((tmp_path / name).read_text()) for name in names)
    assert first["steps"] == 500
    assert first["acting"].keys() == {"agent.json", "agent.safetensors"}
    for name in ("suites", "skills", "steps", "acting", "metrics"):
        assert again[name] == first[name]


def test_what_is_missing_or_damaged_is_told(tmp_path: Path) -> None:
    actor = made(32)
    with pytest.raises(EverystateError, match="train it again"):
        acting.load(tmp_path / "acting", actor.config)
    acting.write(actor, tmp_path / "acting")
    (tmp_path / "acting/actor.safetensors").write_bytes(b"no tensors")
    with pytest.raises(EverystateError, match="is damaged"):
        acting.load(tmp_path / "acting", actor.config)
