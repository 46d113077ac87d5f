"""How the options of a command are read."""

import contextlib
import io
import itertools
from typing import Any, get_args, get_type_hints

import tyro

from everystate.cli.options import Train
from everystate.cli.sections import in_sections
from everystate.config import Config
from everystate.errors import EverystateError, suggest

_PLACED = get_args(tyro.conf.Positional[str])[1]
"""What marks an argument that is told by its place."""


def options_of(kind: type) -> dict[str, Any]:
    """Every option of a command, with its type; what is told by its place is none."""
    types = get_type_hints(kind, include_extras=True)
    known = {
        f"--{name}".replace("_", "-"): type_
        for name, type_ in types.items()
        if _PLACED not in get_args(type_)
    }
    return known | {f"--no-{name[2:]}": bool for name, type_ in known.items() if type_ is bool}


def parse(kind: type, command: str, argv: list[str], default: Any = tyro.MISSING_NONPROP) -> Any:
    """Options by Tyro, but what is wrong with them in one line, with a suggestion."""
    known = options_of(kind)
    for argument in argv:
        option = argument.partition("=")[0].replace("_", "-")
        if option.startswith("--") and option not in {*known, "--help"}:
            raise EverystateError(f"unknown option {option}: {suggest(option, known)}")
    if not {"-h", "--help"}.isdisjoint(argv):
        argv = ["--help"]  # Tyro leaves out what else was given
        if kind is Train:
            kind, default = in_sections(kind, Config, default), tyro.MISSING_NONPROP
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(kind, args=argv, default=default, prog=f"everystate {command}")
    except SystemExit as stop:
        if not stop.code:
            raise
        # Below the title and above the advice, between lines that are drawn.
        lines = [line.strip(" │") for line in said.getvalue().splitlines()[1:]]
        below = itertools.dropwhile(_is_drawn, lines)
        raise EverystateError(
            " ".join(itertools.takewhile(lambda x: not _is_drawn(x), below))
        ) from stop


def _is_drawn(line: str) -> bool:
    return not line.strip("─-╭╮╰╯├┤ ")
