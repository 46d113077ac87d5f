"""The suites there are, by the names of bodies.

A suite is one JSON file, made by a script of `tools/`. A body has one for each question (`rest`:
states it can stay in; `motion`: states that it can only pass), each in two splits of different
seeds: `tune`, to look at while settings are chosen, and `report`.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from everystate import envs
from everystate.agent.json_files import read_json
from everystate.errors import EverystateError, suggest
from everystate.evaluation.suite import Suite
from everystate.evaluation.suite_file import from_json

FOLDER = Path(__file__).with_name("suites")
Split = Literal["tune", "report"]


def names(body: str, options: Sequence[str] = ()) -> tuple[str, ...]:
    """The suites of whole states of a body: those in the package, or one made on the spot."""
    return tuple(name for name in every(body, options) if not name.startswith("parts"))


def every(body: str, options: Sequence[str] = ()) -> tuple[str, ...]:
    """Its suites, those too that ask for parts of states."""
    files = (FOLDER / body).glob("*-report.json")
    found = tuple(sorted(path.stem.removesuffix("-report") for path in files))
    if not found or (options and _state(body, options) != _state(body)):
        return ("visited",)
    return tuple(sorted(found, key=lambda name: name != "rest"))


def load(
    body: str,
    suite: Path | str | None = None,
    options: Sequence[str] = (),
    split: Split = "report",
) -> Suite:
    """A suite of the body by its name, or from a file; by default the first that it has.

    Raises:
        EverystateError: no such suite, or a file that is none, damaged, or of another body.
    """
    known = every(body, options)
    suite = known[0] if suite is None else suite
    if suite == "visited":
        from everystate.evaluation.visited import on_the_spot

        return on_the_spot(body, tuple(options), split)
    shipped = suite in known
    path = FOLDER / body / f"{suite}-{split}.json" if shipped else Path(suite)
    if not shipped and path.suffix != ".json":
        raise EverystateError(
            f"{body} has no suite {str(suite)!r}: {suggest(str(suite), known)}, or the path of a"
            " file ending in .json"
        )
    try:
        found = from_json(read_json(path), options)
    except OSError as error:
        raise EverystateError(f"cannot read goal suite {path}: {error.strerror}") from error
    except (ValueError, TypeError, AttributeError, OverflowError) as error:
        raise EverystateError(f"{path} is no goal suite: {error}") from error
    except KeyError as error:
        raise EverystateError(f"{path} is no goal suite: {error} is missing") from error
    if found.body != body:
        raise EverystateError(f"{path} is a goal suite for {found.body!r}, not for {body!r}")
    return found


def _state(body: str, options: Sequence[str] = ()) -> Sequence[str]:
    return envs.make(body, 1, 0, **envs.parse_options(options)).state_names
