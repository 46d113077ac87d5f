"""The one exception that users are meant to read."""

import difflib
from collections.abc import Iterable


class EverystateError(Exception):
    """Something the user can mend: names the value, what was expected and what to change.

    The command line prints it as one line and exits with code 2.
    """


def suggest(value: str, known: Iterable[str]) -> str:
    """A sentence that names the nearest known value, or all of them when none is near."""
    names = sorted(known)
    near = difflib.get_close_matches(value, names, n=1)
    return f"did you mean {near[0]!r}?" if near else f"choose one of: {', '.join(names)}"
