"""Checkpoints hold everything, appear whole, are few, and say when they are damaged."""

from pathlib import Path

import jax
import numpy as np
import pytest
import safetensors.numpy

from everystate import envs
from everystate.agent import Agent, BodyInfo, named_arrays
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.learning.models import Space
from everystate.presets import preset
from everystate.training import checkpoint
from everystate.training.checkpoint import Snapshot
from everystate.training.collection import warm_up
from everystate.training.groups import Groups, InProcess
from everystate.training.learner import compiled

CONFIG = preset("test", seed=3)


@pytest.fixture(scope="module")
def begun() -> Snapshot:
    env = envs.make(CONFIG.body, CONFIG.num_bodies)
    groups = Groups(CONFIG, InProcess(compiled(CONFIG), env), lambda: False)
    snapshot = warm_up(CONFIG, env, groups)
    assert snapshot is not None
    return snapshot


def at(snapshot: Snapshot, epoch: int) -> Snapshot:
    return snapshot._replace(agent=snapshot.agent._replace(epoch=jax.numpy.int32(epoch)))


def save(folder: Path, snapshot: Snapshot, config: Config = CONFIG, period: int = 1) -> Path:
    agent = Agent(snapshot.agent.models, snapshot.agent.scale, config, BodyInfo(("x", "y"), 2))
    return checkpoint.save(folder, snapshot, agent, period)


def restored(folder: Path) -> Snapshot:
    snapshot = checkpoint.restore(folder, CONFIG, Space(2, 2))
    assert snapshot is not None
    return snapshot


def host(snapshot: Snapshot) -> dict[str, np.ndarray]:
    """Every array of a snapshot by name."""
    arrays = named_arrays(snapshot._replace(agent=snapshot.agent._replace(key=0)))
    arrays["key"] = jax.random.key_data(snapshot.agent.key)
    return {name: np.asarray(x) for name, x in arrays.items()}


def test_everything_comes_back_bit_for_bit(begun: Snapshot, tmp_path: Path) -> None:
    save(tmp_path, begun)
    before, after = host(begun), host(restored(tmp_path))
    assert before.keys() == after.keys()
    for name, array in before.items():
        assert (array.dtype, array.shape) == (after[name].dtype, after[name].shape), name
        assert array.tobytes() == after[name].tobytes(), name


def test_physics_keeps_its_64_bits(begun: Snapshot, tmp_path: Path) -> None:
    save(tmp_path, begun)
    after = restored(tmp_path)
    assert after.env[0]["qpos"].dtype == np.float64
    assert after.env[0]["random"].dtype == np.uint64


def test_no_state_has_weak_dtypes_or_shared_memory(begun: Snapshot, tmp_path: Path) -> None:
    """Either would compile the update again, or break it."""
    save(tmp_path, begun)
    for snapshot in (begun, restored(tmp_path)):
        arrays = named_arrays(snapshot.agent._replace(key=0))
        assert not [name for name, x in arrays.items() if x.weak_type]
        places = [x.unsafe_buffer_pointer() for x in arrays.values()]
        assert len(set(places)) == len(places)


def test_two_last_and_some_older_ones_are_kept(begun: Snapshot, tmp_path: Path) -> None:
    for epoch in range(0, 101, 10):
        save(tmp_path, at(begun, epoch), period=10)
    save(tmp_path, at(begun, 103), period=10)
    kept = [int(path.name) for path in sorted(tmp_path.glob("[0-9]*"))]
    assert kept == [10, 20, 40, 80, 100, 103]


def test_an_epoch_is_saved_once(begun: Snapshot, tmp_path: Path) -> None:
    first = save(tmp_path, begun)
    written = (first / "state.safetensors").stat().st_mtime_ns
    assert save(tmp_path, begun) == first
    assert (first / "state.safetensors").stat().st_mtime_ns == written


def test_a_draft_is_no_checkpoint(begun: Snapshot, tmp_path: Path) -> None:
    """What a killed process leaves behind is neither read nor in the way."""
    draft = tmp_path / ".draft-000000"
    draft.mkdir()
    (draft / "state.safetensors").write_text("{")
    assert checkpoint.restore(tmp_path, CONFIG, Space(2, 2)) is None
    save(tmp_path, begun)
    assert restored(tmp_path).epoch == 0
    assert not draft.exists()


def test_a_place_that_cannot_be_written_is_named(begun: Snapshot, tmp_path: Path) -> None:
    (tmp_path / "checkpoints").write_text("in the way")
    with pytest.raises(EverystateError, match=r"000000 cannot be written \(.*make room"):
        save(tmp_path / "checkpoints", begun)


def damage(folder: Path, how: str) -> None:
    state = folder / "state.safetensors"
    content = bytearray(state.read_bytes())
    if how == "truncated":
        state.write_bytes(content[: len(content) // 2])
    elif how == "changed":
        content[len(content) // 2] ^= 0xFF
        state.write_bytes(content)
    elif how == "missing":
        state.unlink()
    elif how == "wrong":
        state.write_bytes(content.replace(b'"agent.epoch"', b'"agent.epoxy"'))
    elif how == "without checksums":
        safetensors.numpy.save_file(safetensors.numpy.load_file(state), state)


DAMAGES = ("truncated", "changed", "missing", "wrong", "without checksums")


@pytest.mark.parametrize("how", DAMAGES)
def test_a_damaged_checkpoint_falls_back_to_the_one_before(
    begun: Snapshot, tmp_path: Path, how: str
) -> None:
    save(tmp_path, at(begun, 1))
    save(tmp_path, at(begun, 2))
    last = save(tmp_path, at(begun, 3))
    damage(last, how)
    with pytest.warns(UserWarning, match="000003 is damaged"):
        assert restored(tmp_path).epoch == 2
    kept = [path.name for path in sorted(tmp_path.iterdir())]
    assert kept == ["000001", "000002", "damaged-000003-1"]
    assert save(tmp_path, at(begun, 3)) == last, "its place is free again"


def test_without_a_sound_checkpoint_nothing_is_begun(begun: Snapshot, tmp_path: Path) -> None:
    damage(save(tmp_path, begun), "truncated")
    with (
        pytest.warns(UserWarning, match="is damaged"),
        pytest.raises(EverystateError, match=r"no checkpoint in .* is sound"),
    ):
        checkpoint.restore(tmp_path, CONFIG, Space(2, 2))
    assert [p.name for p in tmp_path.iterdir()] == ["000000"]
