"""What `everystate bodies` says of a body."""

import textwrap
from pathlib import Path

import numpy as np
from jaxtyping import Float

from everystate.envs.model_copy import model_files
from everystate.envs.vector import BodyVectorEnv

_STARTS = 20
"""So many tell where a body begins."""


def headline(env: BodyVectorEnv) -> str:
    """Sizes, control step and source, in two lines."""
    pace = f"one every {1000 * env.control_step:g} ms" if env.control_step else "pace unknown"
    sizes = [
        f"{len(names)} {what}{'s' * (len(names) != 1)}"
        for what, names in (("state component", env.state_names), ("action", env.action_names))
    ]
    return f"{env.name}: {', '.join(sizes)}, {pace}\n  from {env.source}"


def description(env: BodyVectorEnv, model: Path | None) -> str:
    """The headline, then a line per component of the state and per action.

    Of a body with a model file of its user's own, `model`, also what travels with a run and its
    agent. The body is reset to see where it begins.
    """
    starts = np.concatenate([env.reset()[0] for _ in range(_STARTS)])
    columns = zip(env.state_names, env.state_units, _ranges(starts), *env.scaling, strict=True)
    state = [
        (name, unit, begins, "constant" if still else f"{centre:.3g} ± {spread:.3g}")
        for name, unit, begins, centre, spread, still in columns
    ]
    actions = zip(env.action_names, _ranges(np.stack(env.action_bounds)), strict=True)
    parts = [
        headline(env),
        _table(("state", "unit", "begins at", "scale"), state),
        _table(("action, from -1 to 1", "is to the body"), list(actions)),
    ]
    if model:
        files = ", ".join(file.name for file in model_files(model))
        told = (
            f"travels with a run and its agent: copies of {files}, and the hash"
            f" {env.model_hash[:12]}... of what it compiles to"
        )
        parts.append(textwrap.fill(told, 78, initial_indent="  ", subsequent_indent="    "))
    return "\n".join(parts)


def _ranges(rows: Float[np.ndarray, "n columns"]) -> list[str]:
    """Least and most of each column, once where they look the same."""
    ends = ([f"{x + 0.0:.3g}" for x in column] for column in (rows.min(axis=0), rows.max(axis=0)))
    return [low if low == high else f"{low} to {high}" for low, high in zip(*ends, strict=True)]


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    cells = [head, *((f"  {first}", *rest) for first, *rest in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in cells
    )
    return "\n".join(f"  {line}".rstrip() for line in lines)
