"""No command line is a traceback.

    python tests/trust/fuzz_commands.py [EXAMPLES] [--out FILE]

Puts words together, known and unknown, and types them: each is done, or refused in one line. What
takes its time is left out: a run is begun, and ends before its first epoch. FILE gets how many
there were: results/trust/fuzz-commands.json.
"""

import argparse
import contextlib
import io
import os
import shutil
import tempfile
from dataclasses import fields
from pathlib import Path

from hypothesis import example, given, settings
from hypothesis import strategies as st

from everystate import cli, evaluation, studies, viewing
from everystate.cli import options
from everystate.evaluation import raw
from everystate.studies import comparison, pool
from everystate.training import loop
from everystate.viewing import studio

FOLDER = Path(tempfile.mkdtemp())
KINDS = (
    options.Train,
    options.Evaluate,
    options.Score,
    options.Compare,
    options.Report,
    options.Render,
    options.Studio,
)
OPTIONS = sorted({f"--{field.name}" for kind in KINDS for field in fields(kind)})
BODIES = ["ramp-pointmass", "cartpole", "no-body", "nothing.xml", "gymnasium:No-v0", "os:system"]
NUMBERS = ["0", "1", "-1", "3.5", "1e400", "nan", "inf", "-inf", "99999999999999999999", "0x10", ""]
PATHS = ["runs/a", "/proc/none", "/dev/null", "../x", "a\x00b", "~", "é" * 300]
OTHERS = [
    "true",
    "percentile",
    "motion",
    "quick",
    "--no-json",
    "--help",
    "a=b",
    "seed=1",
    "=",
    "--",
]

WORDS = st.sampled_from([*OPTIONS, *BODIES, *NUMBERS, *PATHS, *OTHERS]) | st.text(max_size=8)
PAIRS = st.tuples(
    st.sampled_from(OPTIONS), st.sampled_from([*NUMBERS, *PATHS, *OTHERS]) | st.text(max_size=5)
)
LINES = st.builds(
    lambda command, body, pairs, rest: [
        command,
        body,
        *(word for pair in pairs for word in pair),
        *rest,
    ],
    st.sampled_from([*cli.COMMANDS, "trian"]),
    st.sampled_from(BODIES),
    st.lists(PAIRS, max_size=2),
    st.lists(WORDS, max_size=2),
)


@given(line=LINES | st.lists(WORDS, max_size=4))
@example(line=["train", "ramp-pointmass", "--body-options", "travel=maybe"])
@example(line=["train", "ramp-pointmass", "--seed", "-1"])
@example(line=["train"])
def a_command_line(line: list[str]) -> None:
    """Done, or an error of one bearable line."""
    said, shown = io.StringIO(), io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(shown):
        try:
            code = cli.main(line)
        except SystemExit as stop:  # --help
            code = stop.code
    assert code in (0, None, 2), (code, line)
    if code == 2:
        lines = [x for x in said.getvalue().splitlines() if not x.startswith("warning: ")]
        assert len(lines) == 1, (line, lines)
        assert lines[0].startswith("error: "), lines
        assert len(lines[0]) < 2_000, lines


def main() -> None:
    """So many of them."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("examples", type=int, nargs="?", default=500)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    examples: int = arguments.examples
    for module, name in (
        (loop, "_run"),
        (pool, "_make"),
        (comparison, "write"),
        (studies, "table"),
        (evaluation, "evaluate"),
        (evaluation, "tables"),
        (viewing, "report"),
        (viewing, "render"),
        (studio, "studio"),
    ):
        setattr(module, name, lambda *_, **__: ())
    back = os.getcwd()
    os.chdir(FOLDER)
    try:
        settings(max_examples=examples, deadline=None, derandomize=True, database=None)(
            a_command_line
        )()
        print(f"{examples} command lines, none of them a traceback")
    finally:
        os.chdir(back)
        shutil.rmtree(FOLDER)
    if arguments.out is not None:
        raw.write(arguments.out, {"command_lines": examples, "tracebacks": 0}, replace=True)


if __name__ == "__main__":
    main()
