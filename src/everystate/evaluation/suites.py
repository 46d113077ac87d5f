"""The suites there are, by the names of bodies.

A suite is one JSON file, made by a script of `tools/`. A body has one for each question (`rest`:
states it can stay in; `motion`: states that it can only pass), each in two splits of different
seeds: `tune`, to look at while settings are chosen, and `report`.
"""

from collections.abc import Sequence
from pathlib import Path

from everystate import envs
from everystate.agent.json_files import read_json
from everystate.errors import EverystateError, suggest
from everystate.evaluation import on_the_spot
from everystate.evaluation.suite import Split, Suite
from everystate.evaluation.suite_file import from_json

FOLDER = Path(__file__).with_name("suites")


def names(body: str, options: Sequence[str] = (), split: Split = "report") -> tuple[str, ...]:
    """The suites of whole states of a body: those in the package, or those made on the spot."""
    return tuple(name for name in every(body, options, split) if not name.startswith("parts"))


def every(body: str, options: Sequence[str] = (), split: Split = "report") -> tuple[str, ...]:
    """Its suites, those too that ask for parts of states."""
    return _shipped(body, options) or on_the_spot.names(body, tuple(options), split)


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
    shipped = _shipped(body, options)
    known = shipped or tuple(on_the_spot.MAKERS)
    if not shipped and (suite is None or suite in known):
        return on_the_spot.suite(body, tuple(options), split, suite and str(suite))
    suite = known[0] if suite is None else suite
    path = FOLDER / body / f"{suite}-{split}.json" if suite in known else Path(suite)
    if suite not in known and path.suffix != ".json":
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


def _shipped(body: str, options: Sequence[str]) -> tuple[str, ...]:
    """Those in the package; none where the body's options make its state another."""
    files = (FOLDER / body).glob("*-report.json")
    found = sorted(path.stem.removesuffix("-report") for path in files)
    if found and options and _state(body, options) != _state(body):
        return ()
    return tuple(sorted(found, key=lambda name: name != "rest"))


def _state(body: str, options: Sequence[str] = ()) -> Sequence[str]:
    return envs.make(body, 1, 0, **envs.parse_options(options)).state_names
