"""The help of `everystate train`: what a run is called for first, then the config by its sections.

The titles are the docstrings of its groups, and texts are what stands below each field: both are
read from the source, which Tyro reads too.
"""

import ast
import dataclasses
import inspect
from typing import Annotated, Any, get_type_hints

import tyro

FIRST = ("body", "preset", "config", "seed", "epochs", "run_dir", "body_options")
"""Of a run, before all else of its own and before the sections."""


def sections(config: type) -> dict[str, list[str]]:
    """Names of a dataclass's fields by the group that has them; its own are those of the run."""
    found = {}
    for group in reversed([c for c in config.__mro__ if dataclasses.is_dataclass(c)]):
        title = "The run" if group is config else inspect.getdoc(group) or ""
        found[title.rstrip(".")] = list(inspect.get_annotations(group))
    return found


def texts(kind: type) -> dict[str, str]:
    """What stands below each field of a dataclass and of those it is built upon."""
    found = {}
    for one in reversed([c for c in kind.__mro__ if dataclasses.is_dataclass(c)]):
        (definition,) = ast.parse(inspect.getsource(one)).body
        assert isinstance(definition, ast.ClassDef)
        for field, text in zip(definition.body, definition.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
                name, said = ast.unparse(field.target), ast.literal_eval(text.value)
                found[name] = " ".join(said.split())
    return found


def in_sections(kind: type, config: type, defaults: Any) -> Any:
    """A class with the options of `kind`, a dataclass upon `config`, for Tyro to show the help of.

    Those of a section of `config` are a class of their own: Tyro draws a frame around these.
    """
    types, text = get_type_hints(kind, include_extras=True), texts(kind)

    def fields(names: list[str]) -> list[tuple[str, Any, Any]]:
        told = {name: Annotated[types[name], tyro.conf.arg(help=text[name])] for name in names}
        return [(name, one, getattr(defaults, name)) for name, one in told.items()]

    of_config = [field.name for field in dataclasses.fields(config)]
    own = [field.name for field in dataclasses.fields(kind) if field.name not in of_config]
    shown: list[tuple[str, Any, Any]] = fields(list(dict.fromkeys((*FIRST, *own))))
    for title, names in sections(config).items():
        if rest := [name for name in names if name not in FIRST]:
            group = dataclasses.make_dataclass("Section", fields(rest), frozen=True)
            called = tyro.conf.arg(name=title, help="")
            shown.append((f"section_{len(shown)}", Annotated[group, called], group()))
    made = dataclasses.make_dataclass(kind.__name__, shown, frozen=True)
    made.__doc__ = kind.__doc__
    return tyro.conf.OmitArgPrefixes[made]
