"""What `everystate bodies` says of a body."""

import textwrap
from pathlib import Path

from everystate.envs.model_copy import model_files
from everystate.envs.vector import BodyVectorEnv

_SPACE = "\N{NO-BREAK SPACE}"  # keeps a name and what belongs to it on one line


def description(env: BodyVectorEnv, model: Path | None) -> str:
    """Sizes, control step, source, state and actions, in lines of at most 80 characters.

    Actions whose own units are others have in brackets what -1 and 1 are to the body. Of a body
    with a model file of its user's own, `model`, also what travels with a run and its agent.
    """
    pace = f"one every {1000 * env.control_step:g} ms" if env.control_step else "pace unknown"
    state = [
        name + ("" if unit == "1" else f" [{unit}]") + (" (constant)" if still else "")
        for name, unit, still in zip(
            env.state_names, env.state_units, env.scaling.constant, strict=True
        )
    ]
    actions = [
        name + ("" if (low, high) == (-1, 1) else f" ({low:g} to {high:g})")
        for name, low, high in zip(env.action_names, *env.action_bounds, strict=True)
    ]
    head = f"{env.name}: {len(state)} state components, {len(actions)} actions, {pace}"
    told = [
        f"from {env.source}",
        f"state: {_listed(state)}",
        f"actions, from -1 to 1 each: {_listed(actions)}",
    ]
    if model:
        files = ", ".join(file.name for file in model_files(model))
        told.append(
            f"travels with a run and its agent: copies of {files}, and the hash"
            f" {env.model_hash[:12]}... of what it compiles to"
        )
    lines = (textwrap.fill(x, 78, initial_indent="  ", subsequent_indent="    ") for x in told)
    return "\n".join([head, *lines]).replace(_SPACE, " ")


def _listed(parts: list[str]) -> str:
    return ", ".join(part.replace(" ", _SPACE) for part in parts)
