"""A damaged file is read or refused, never a traceback.

    python tests/trust/fuzz_files.py [EXAMPLES] [--out FILE]

Damages agents, goal suites, recordings, and the configs, metrics, samples and checkpoints of runs,
and fails with the shortest damage that is neither read nor refused by an `EverystateError`. It runs
in a process of its own, as users do: under pytest types are checked that are not checked elsewhere.
FILE gets how many there were: results/trust/fuzz-files.json.
"""

import argparse
import json
import resource
import shutil
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from everystate import load, train
from everystate.agent import BodyInfo
from everystate.benchmark import recording
from everystate.envs import make
from everystate.envs.model_copy import copied_model, copy_model
from everystate.errors import EverystateError
from everystate.evaluation import raw, suites
from everystate.learning.models import Space
from everystate.presets import preset
from everystate.training import checkpoint
from everystate.training.collection import read_samples
from everystate.training.logging import read_metrics
from everystate.training.rundir import open_run

SOUND = Path(suites.__file__).parents[1] / "agents" / "ramp-pointmass"
AGENT = (SOUND / "agent.json").read_text()
ARRAYS = (SOUND / "agent.safetensors").read_bytes()
SUITE = (suites.FOLDER / "cartpole" / "rest-report.json").read_text()
DEEP = b"[" * 5_000
FOLDER = Path(tempfile.mkdtemp())
CONFIG, RUN = preset("test", epochs=1), FOLDER / "run"
BODY = BodyInfo(("x", "y"), 2, make(CONFIG.body, 1, 0).model_hash)
MEMORY = 1 << 30
"""Bytes by which reading one file may make the process larger."""

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)


def places(value: Any, here: tuple = ()) -> list[tuple]:
    """The ways to all values within a JSON value, of long lists only to the first few."""
    inside = value.items() if isinstance(value, dict) else ()
    if isinstance(value, list):
        inside = enumerate(value[:3])
    return [here, *(way for key, one in inside for way in places(one, (*here, key)))]


@st.composite
def damaged(draw: st.DrawFn, text: str) -> bytes:
    """A JSON file with a value replaced or left out, with an end cut off, or a byte changed."""
    if draw(st.booleans()):
        raw = bytearray(text.encode())
        at = draw(st.integers(0, len(raw) - 1))
        if draw(st.booleans()):
            return bytes(raw[:at])
        raw[at] = draw(st.integers(0, 255))
        return bytes(raw)
    whole = {"": json.loads(text)}
    *way, last = ("", *draw(st.sampled_from(places(whole[""]))))
    place: Any = whole
    for key in way:
        place = place[key]
    if way and draw(st.booleans()):
        del place[last]
    else:
        place[last] = draw(VALUES)
    return json.dumps(whole[""]).encode()


def survives(read: Callable[[], Any]) -> bool:
    """It reads, or says in bearably many words why not; returns whether it reads."""
    said = ""
    try:
        read()
    except EverystateError as error:
        said = str(error)
        assert 0 < len(said) < 2_000, said
    return not said


def same_json(content: bytes, text: str) -> bool:
    """Whether a file still says what it said."""
    try:
        return json.loads(content) == json.loads(text)
    except (ValueError, RecursionError):
        return False


def claim() -> None:
    """A second start of a run."""
    with open_run(RUN, CONFIG, BODY):
        pass


train(CONFIG, run_dir=RUN, progress=False)
RUN_CONFIG, METRICS = (RUN / "config.json").read_text(), (RUN / "metrics.jsonl").read_text()
SAMPLES = (RUN / "samples" / "000001.npz").read_bytes()
CHECKPOINT = RUN / "checkpoints" / "000001"
PARTS = sorted(p.relative_to(CHECKPOINT) for p in CHECKPOINT.rglob("*") if p.is_file())


OWN = {
    "body": "ramp-pointmass",
    "components": ["x", "y", "z"],
    "sigma": [0.5, 0.5, 0.2],
    "position": ["x", "y"],
    "tasks": [{"start": [0, 0], "goal": [0.5, 0], "horizon": 4}],
}
(FOLDER / "own.json").write_text(json.dumps(OWN))
WAYS = recording.save(
    FOLDER / "ways.safetensors",
    "everystate/RampPointmassRest-v1",
    np.zeros((1, 5, 2)),
    suite=FOLDER / "own.json",
).read_bytes()
COPY = FOLDER / "body"
(FOLDER / "arm.xml").write_text(
    "<mujoco><worldbody><body><joint name='j'/><geom size='1'/></body></worldbody>"
    "<actuator><motor joint='j'/></actuator></mujoco>"
)
copy_model(FOLDER / "arm.xml", COPY)
LIST = (COPY / "body.json").read_text()


def bomb() -> bytes:
    """Samples that say of themselves that they are large: a gigabyte of zeros, of a megabyte."""
    path = FOLDER / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("goals.npy", bytes(MEMORY))
    return path.read_bytes()


@given(content=damaged(AGENT))
@example(content=DEEP)
@example(content=AGENT.replace('"config": {', '"config": [], "x": {').encode())
def an_agent(content: bytes) -> None:
    """agent.json: what says anything else is refused."""
    (FOLDER / "agent.safetensors").write_bytes(ARRAYS)
    (FOLDER / "agent.json").write_bytes(content)
    reads = survives(lambda: load(FOLDER))
    assert same_json(content, AGENT) or not reads, "it says something else, and nobody noticed"


@given(at=st.integers(0, len(ARRAYS) - 1), byte=st.none() | st.integers(0, 255))
def its_arrays(at: int, byte: int | None) -> None:
    """agent.safetensors: whatever was changed is refused."""
    content = ARRAYS[:at] if byte is None else ARRAYS[:at] + bytes([byte]) + ARRAYS[at + 1 :]
    (FOLDER / "agent.safetensors").write_bytes(content)
    (FOLDER / "agent.json").write_text(AGENT)
    reads = survives(lambda: load(FOLDER))
    assert content == ARRAYS or not reads, "it was changed, and nobody noticed"


@given(content=damaged(LIST))
@example(content=DEEP)
@example(content=b'{"model": "/etc/passwd", "files": {"/etc/passwd": "0"}}')
@example(content=b'{"model": "../arm.xml", "files": {"../arm.xml": "0"}}')
def a_bodys_list(content: bytes) -> None:
    """body/body.json; what lies elsewhere is never the model."""
    (COPY / "body.json").write_bytes(content)
    found = []
    survives(lambda: found.append(copied_model(COPY)))
    assert found in ([], [COPY / "arm.xml"])


@given(content=damaged(SUITE))
@example(content=DEEP)
def a_goal_suite(content: bytes) -> None:
    """--suite FILE."""
    (FOLDER / "goals.json").write_bytes(content)
    survives(lambda: suites.load("cartpole", FOLDER / "goals.json"))


@given(at=st.integers(0, len(WAYS) - 1), byte=st.none() | st.integers(0, 255))
@example(at=0, byte=255)
def a_recording(at: int, byte: int | None) -> None:
    """What `everystate score` reads."""
    path = FOLDER / "ways.safetensors"
    path.write_bytes(WAYS[:at] + (b"" if byte is None else bytes([byte]) + WAYS[at + 1 :]))
    survives(lambda: recording.read(path, FOLDER / "own.json"))


@given(content=damaged(RUN_CONFIG))
@example(content=DEEP)
@example(content=b'{"config": 1, "format": 1}')
def a_runs_config(content: bytes) -> None:
    """config.json of a run that is to go on."""
    (RUN / "config.json").write_bytes(content)
    survives(claim)


@given(content=damaged(METRICS.splitlines()[0]))
@example(content=DEEP)
@example(content=b"\xff\xfe")
def a_runs_metrics(content: bytes) -> None:
    """metrics.jsonl, of which a run that goes on reads the lines before."""
    (RUN / "metrics.jsonl").write_bytes(content)
    survives(lambda: read_metrics(RUN))


@given(at=st.integers(0, len(SAMPLES) - 1), byte=st.none() | st.integers(0, 255))
def a_runs_samples(at: int, byte: int | None) -> None:
    """samples/*.npz."""
    path = FOLDER / "samples.npz"
    path.write_bytes(SAMPLES[:at] + (b"" if byte is None else bytes([byte]) + SAMPLES[at + 1 :]))
    survives(lambda: read_samples(path))


@st.composite
def damaged_part(draw: st.DrawFn) -> tuple[Path, bytes | None]:
    """One file of a checkpoint, as it may have become; None where it is gone."""
    part = draw(st.sampled_from(PARTS))
    content = bytearray((CHECKPOINT / part).read_bytes())
    kind = draw(st.sampled_from(["gone", "cut", "changed", "head changed"]))
    if kind == "gone":
        return part, None
    at = draw(st.integers(0, min(len(content), 2_000 if kind == "head changed" else 10**9) - 1))
    if kind == "cut":
        return part, bytes(content[:at])
    content[at] = draw(st.integers(0, 255))
    return part, bytes(content)


@given(part=damaged_part())
def a_checkpoint(part: tuple[Path, bytes | None]) -> None:
    """Any file of a checkpoint; what is restored of one that was changed is what it was."""
    path, content = part
    folder = FOLDER / "checkpoints"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(CHECKPOINT, folder / "000001")
    if content is None:
        (folder / "000001" / path).unlink()
    else:
        (folder / "000001" / path).write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        survives(lambda: checkpoint.restore(folder, CONFIG, Space(2, 2)))


def bombs() -> None:
    """Files that unpack to far more than they are."""
    path = FOLDER / "samples.npz"
    path.write_bytes(bomb())
    before = peak()
    survives(lambda: read_samples(path))
    assert peak() - before < MEMORY / 2
    np.savez(path, goals=np.array([print], dtype=object), next_observations=0, visited=0)
    survives(lambda: read_samples(path))  # nor is it unpickled
    encrypted = bytearray(SAMPLES)  # so says a bit of the entry in the table at the end
    encrypted[SAMPLES.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(encrypted)
    survives(lambda: read_samples(path))


def peak() -> int:
    """The most memory the process had, in bytes."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


CHECKS = (
    an_agent,
    its_arrays,
    a_bodys_list,
    a_goal_suite,
    a_recording,
    a_runs_config,
    a_runs_metrics,
    a_runs_samples,
    a_checkpoint,
)


def main() -> None:
    """Every kind of file, so many times each."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("examples", type=int, nargs="?", default=500)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    examples: int = options.examples
    try:
        bombs()
        before = peak()
        for check in CHECKS:
            settings(max_examples=examples, deadline=None, derandomize=True, database=None)(check)()
            print(f"{check.__name__}: {examples} examples, none of them a traceback")
        grown = peak() - before
        assert grown < MEMORY, f"reading them took {grown} bytes"
        print(f"most memory taken beyond the start's: {grown / 1e6:.0f} MB")
        if options.out is not None:
            kinds = [check.__name__ for check in CHECKS]
            said = {"examples_each": examples, "kinds": kinds, "tracebacks": 0}
            raw.write(options.out, said | {"megabytes_taken": round(grown / 1e6)}, replace=True)
    finally:
        shutil.rmtree(FOLDER)


if __name__ == "__main__":
    main()
