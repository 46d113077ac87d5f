"""A damaged file is read or refused, never a traceback: `python tests/fuzz_files.py [EXAMPLES]`.

Damages agents, goal suites and configs of runs, and fails with the shortest damage that is neither
read nor refused by an `EverystateError`. It runs in a process of its own, as users do: under
pytest types are checked that are not checked elsewhere.
"""

import json
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import example, given, settings
from hypothesis import strategies as st

from everystate import load
from everystate.errors import EverystateError
from everystate.evaluation import suites
from everystate.presets import preset
from everystate.training.rundir import open_run

SOUND = Path(suites.__file__).parents[1] / "agents" / "ramp-pointmass"
AGENT = (SOUND / "agent.json").read_text()
ARRAYS = (SOUND / "agent.safetensors").read_bytes()
SUITE = (suites.FOLDER / "cartpole.json").read_text()
DEEP = b"[" * 5_000
FOLDER = Path(tempfile.mkdtemp())
CONFIG, RUN = preset("test"), FOLDER / "run"

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


def survives(read: Callable[[], Any]) -> None:
    """It reads, or says in bearably many words why not."""
    said = "nothing"
    try:
        read()
    except EverystateError as error:
        said = str(error)
    assert 0 < len(said) < 2_000, said


def claim() -> None:
    """A second start of a run."""
    with open_run(RUN, CONFIG):
        pass


claim()
RUN_CONFIG = (RUN / "config.json").read_text()


@given(content=damaged(AGENT))
@example(content=DEEP)
@example(content=AGENT.replace('"config": {', '"config": [], "x": {').encode())
def an_agent(content: bytes) -> None:
    """agent.json."""
    (FOLDER / "agent.safetensors").write_bytes(ARRAYS)
    (FOLDER / "agent.json").write_bytes(content)
    survives(lambda: load(FOLDER))


@given(at=st.integers(0, len(ARRAYS) - 1), byte=st.none() | st.integers(0, 255))
def its_arrays(at: int, byte: int | None) -> None:
    """agent.safetensors; a number that was changed cannot be told from another."""
    content = ARRAYS[:at] if byte is None else ARRAYS[:at] + bytes([byte]) + ARRAYS[at + 1 :]
    (FOLDER / "agent.safetensors").write_bytes(content)
    (FOLDER / "agent.json").write_text(AGENT)
    survives(lambda: load(FOLDER))


@given(content=damaged(SUITE))
@example(content=DEEP)
def a_goal_suite(content: bytes) -> None:
    """--goals FILE."""
    (FOLDER / "goals.json").write_bytes(content)
    survives(lambda: suites.load("cartpole", FOLDER / "goals.json"))


@given(content=damaged(RUN_CONFIG))
@example(content=DEEP)
@example(content=b'{"config": 1, "format": 1}')
def a_runs_config(content: bytes) -> None:
    """config.json of a run that is to go on."""
    (RUN / "config.json").write_bytes(content)
    survives(claim)


def main() -> None:
    """Every kind of file, so many times each."""
    examples = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    try:
        for check in (an_agent, its_arrays, a_goal_suite, a_runs_config):
            settings(max_examples=examples, deadline=None, derandomize=True, database=None)(check)()
            print(f"{check.__name__}: {examples} examples, none of them a traceback")
    finally:
        shutil.rmtree(FOLDER)


if __name__ == "__main__":
    main()
