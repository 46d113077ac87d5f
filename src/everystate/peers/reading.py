"""How the results of an evaluation are read: nothing else here knows how they are laid out."""

from collections.abc import Mapping, Sequence
from typing import Any


def suites(results: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of the suites that some of them were measured on."""
    return list(dict.fromkeys(name for one in results for name in one.get("suites", {})))


def groups(results: Sequence[Mapping[str, Any]], suite: str) -> list[str]:
    """Of the tasks of a suite, but for `all`."""
    scores = (of(one, suite, "score") or {} for one in results)
    return [g for g in dict.fromkeys(g for score in scores for g in score) if g != "all"]


def of(result: Mapping[str, Any], suite: str, *names: str, by: str = "policy") -> Any:
    """What was measured on a suite, or its `summary` over seeds; None where it was not."""
    found: Any = result
    for name in ("suites", suite, by, *names):
        found = found.get(name) if isinstance(found, Mapping) else None
    return found


def planned(result: Mapping[str, Any]) -> bool:
    """Whether planning was measured too."""
    return any(of(result, suite, "score", by="planning") for suite in suites([result]))


def looked(line: Mapping[str, Any]) -> dict[str, float]:
    """By SUITE/GROUP, the scores that a line of metrics has; empty where it has none."""
    scored = (n.split("/") for n in line if n.startswith("eval/") and "/score/" in n)
    return {
        f"{suite}/{group}": line[f"eval/{suite}/score/{group}"] for _, suite, _, group in scored
    }
