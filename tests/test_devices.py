"""Several devices and hosts do what one does, and say what is wrong with them."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from everystate import preset, training
from everystate.errors import EverystateError
from everystate.learning.sharding import joined, split
from everystate.training.hosts import shared
from sharded_update import SMALL
from waiting import until

TOLERANCE = 1e-5
"""A two-hundredth of a step of Adam, of which every parameter may be off: sums are added up in
another order."""


def compared(what: str) -> dict[str, float]:
    script = Path(__file__).with_name("sharded_update.py")
    done = subprocess.run([sys.executable, script, what], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2_000:]
    return json.loads(done.stdout.splitlines()[-1])


def test_an_update_over_four_devices_is_that_of_one() -> None:
    off = compared("once")
    assert off["drawn"] == 0, "the same keys and shapes"
    assert off["other_actions"] == 0
    assert off["models"] < TOLERANCE
    assert off["optimisers"] < TOLERANCE
    assert off["sums"] < TOLERANCE


@pytest.mark.slow
def test_an_epoch_over_four_devices_is_that_of_one() -> None:
    assert compared("epoch")["models"] < TOLERANCE


def test_on_one_device_nothing_is_shared_out() -> None:
    config, examples = preset("test"), (np.zeros(3), "whatever")
    for function in (split, joined, shared):
        assert function(config, examples) is examples


def test_every_device_has_as_many_examples() -> None:
    with pytest.raises(EverystateError, match=r"devices = 3 does not divide batch_size = 32.* 33"):
        preset("test", devices=3)


def test_more_devices_than_there_are_is_told_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(EverystateError, match=r"has 1 on 1 host.*device_count=4 in the env"):
        training.train("ramp-pointmass", preset="test", devices=4, run_dir=tmp_path / "run")
    assert not list(tmp_path.iterdir())


def started(run: Path, *words: str, devices: int = 1) -> subprocess.Popen:
    fields = [f"--{name.replace('_', '-')}={value}" for name, value in SMALL.items()]
    command = [sys.executable, "-m", "everystate", "train", "ramp-pointmass", "--preset", "test"]
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    return subprocess.Popen(
        [*command, *fields, "--epochs", "2", "--quiet", "--run-dir", str(run), *words],
        env=os.environ | {"XLA_FLAGS": flags},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def on_hosts(run: Path, *each: tuple[str, ...]) -> list[subprocess.Popen]:
    """One process for each of these, with its own words."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        where = f"127.0.0.1:{free.getsockname()[1]}"
    common = "--devices", str(len(each)), "--hosts", str(len(each)), "--coordinator", where
    return [started(run, *common, "--host-id", str(i), *words) for i, words in enumerate(each)]


def ended(process: subprocess.Popen, code: int = 0) -> str:
    """What it said, once it is done."""
    said = "".join(process.communicate(timeout=600))
    assert process.returncode == code, said[-2_000:]
    return said


def last(run: Path) -> dict[str, np.ndarray]:
    return safetensors.numpy.load_file(run / "checkpoints" / "000002" / "state.safetensors")


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    return one.keys() == other.keys() and all(
        x.tobytes() == other[n].tobytes() for n, x in one.items()
    )


@pytest.fixture(scope="module")
def two_devices(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("runs") / "two"
    ended(started(run, "--devices", "2", devices=2))
    return run


@pytest.mark.slow
def test_a_run_on_several_devices_goes_on_bit_for_bit(two_devices: Path, tmp_path: Path) -> None:
    resumed = tmp_path / "resumed"
    shutil.copytree(two_devices, resumed)
    shutil.rmtree(resumed / "checkpoints" / "000002")
    ended(started(resumed, "--devices", "2", devices=2))
    assert same(last(resumed), last(two_devices))
    assert "devices 2 there and 1 here" in ended(started(resumed, "--devices", "1"), code=2)


@pytest.mark.slow
def test_two_hosts_do_what_one_with_two_devices_does(two_devices: Path, tmp_path: Path) -> None:
    run = tmp_path / "hosts"
    first, second = on_hosts(run, (), ("--run-dir", str(tmp_path / "unused")))
    assert "finished" in ended(first)
    ended(second)
    assert not (tmp_path / "unused").exists()
    assert same(last(run), last(two_devices))


@pytest.mark.slow
def test_hosts_that_were_told_different_things_say_so(tmp_path: Path) -> None:
    for process in on_hosts(tmp_path / "run", (), ("--seed", "1")):
        assert "different configs" in ended(process, code=2)


@pytest.mark.slow
def test_a_host_that_dies_does_not_leave_the_other_waiting(tmp_path: Path) -> None:
    run = tmp_path / "run"
    first, second = on_hosts(run, ("--epochs", "100000"), ("--epochs", "100000"))
    until(lambda: (run / "checkpoints").exists(), seconds=600)
    second.kill()
    second.communicate()
    said = "".join(first.communicate(timeout=300))
    assert first.returncode != 0
    assert "host was lost" in said or "another task died" in said


@pytest.mark.slow
def test_ctrl_c_at_the_first_host_saves_and_sends_the_other_home(tmp_path: Path) -> None:
    run = tmp_path / "run"
    first, second = on_hosts(run, ("--epochs", "100000"), ("--epochs", "100000"))
    until(lambda: (run / "checkpoints").exists(), seconds=600)
    first.send_signal(signal.SIGINT)
    assert "holds the run after epoch" in ended(first, code=130)
    ended(second)
