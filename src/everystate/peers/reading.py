"""How the results of an evaluation are read: nothing else here knows how they are laid out."""

from collections.abc import Mapping
from typing import Any

_LOOK = "eval/success@0.5/"  # of the metrics of a run, and then the region


def regions(result: Mapping[str, Any]) -> list[str]:
    """Names of the parts of the world that goals lie in."""
    return [name for name in result["success"] if name != "all"]


def rate(
    result: Mapping[str, Any],
    region: str = "all",
    *,
    eps: str = "0.5",
    last: bool = True,
    which: str = "success",
) -> Any:
    """The share of goals reached, or its `summary` over seeds; None where it was not measured.

    Args:
        result: of one evaluation, or of several over seeds.
        region: of the goals.
        eps: within so many sigma.
        last: at the last step; otherwise at any.
        which: `success`, `success_plan` or `position_only`.
    """
    found: Any = result.get(which)
    for name in (region, eps, "last" if last else "any"):
        found = found.get(name) if isinstance(found, Mapping) else None
    return found


def look(result: Mapping[str, Any]) -> dict[str, float]:
    """What a line of metrics says of an evaluation while training."""
    return {f"{_LOOK}{name}": rate(result, name) for name in [*regions(result), "all"]}


def looked(line: Mapping[str, Any]) -> dict[str, float]:
    """By region, what such a line says; empty where it says nothing."""
    return {n.removeprefix(_LOOK): x for n, x in line.items() if n.startswith(_LOOK)}
