"""The main numbers of a study as tables of Markdown."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from everystate.evaluation.markdown import markdown, percent, percent_interval

NONE = "—"
_CAPTION = (
    f"{NONE}: not measured. Who does not learn visits no cells; cells are told for bodies of up to"
    " three dimensions; skills where a body has any.\n"
)
_TIMED = (
    "What is told after equal steps is of the policy and of the other split of the goals, which is"
    " looked at in training.\n"
)


def table(result: Mapping[str, Any]) -> str:
    """Of each body a table for each suite, one of the skills, one of the runs.

    Medians over seeds, in per cent, a row per condition, and one more where planning was measured.
    Beside the score over all goals of a suite stand the 90 % interval of its interquartile mean and
    the worst seed. No condition is left out: what was not measured is a dash, and below the tables
    stands why.
    """
    conditions = result["conditions"]
    bodies = list(dict.fromkeys(one["body"] for one in conditions.values() if one["seeds"]))
    parts = []
    for body in bodies:
        few = {n: one for n, one in conditions.items() if one.get("body", bodies[0]) == body}
        rows = {(name, "policy"): one for name, one in few.items()}
        rows |= {(name, "planning"): one for name, one in few.items() if _planned(one)}
        parts += [f"{body}:\n"] if len(bodies) > 1 else []
        parts += [_suite(result, rows, suite) for suite in _suites(rows.values())]
        parts += [_skills(rows), _runs(few)]
    text = "\n".join([*(part for part in parts if part), _CAPTION])
    text += _TIMED if "equal_steps" in result else ""
    missing = [name for name, one in conditions.items() if not one["seeds"]]
    if missing:
        text += f"\nNo run of {', '.join(missing)} was finished.\n"
    return text


_Rows = Mapping[tuple[str, str], Mapping[str, Any]]


def _suite(result: Mapping[str, Any], rows: _Rows, suite: str) -> str:
    """Scores by group, and what is beside the score over all."""
    scores = (_of(one, suite, "score") or {} for one in rows.values())
    groups = [g for g in dict.fromkeys(g for score in scores for g in score) if g != "all"]
    timed = "equal_steps" in result
    heads = [suite, "seeds", *groups, "all", "worst seed", "end @1", "hit @0.5", "rms hit @0.5"]
    heads += ["position only", "nearest, rms σ"]
    heads += [f"all, after {result['equal_steps']:,} steps"] if timed else []
    cells = []
    for (name, by), one in rows.items():

        def of(*names: str, one: Mapping[str, Any] = one, by: str = by) -> Any:
            return _of(one, suite, *names, by=by)

        equal = one.get("at_equal_steps", {}).get(f"{suite}/all") if by == "policy" else None
        cells.append(
            [
                _title(name, by),
                f"{len(one['seeds'])}",
                *(_cell(percent, of("score", group)) for group in groups),
                _cell(percent_interval, of("score", "all")),
                _cell(lambda x: f"{100 * min(x['values']):.0f}", of("score", "all")),
                _cell(percent, of("success", "max", "all", "1", "end")),
                _cell(percent, of("success", "max", "all", "0.5", "hit")),
                _cell(percent, of("success", "rms", "all", "0.5", "hit")),
                _cell(percent, of("position_only", "all", "0.5", "end")),
                _cell(lambda x: f"{x['median']:.2f}", of("closest", "all", "nearest")),
                *([_cell(percent, equal)] if timed else []),
            ]
        )
    return markdown(heads, cells)


def _skills(rows: _Rows) -> str:
    """Starts from which each skill succeeded; nothing where the body has none."""
    rates = {row: (one.get("skills") or {}).get(row[1]) or {} for row, one in rows.items()}
    names = list(dict.fromkeys(name for rate in rates.values() for name in rate))
    if not names:
        return ""
    cells = [
        [_title(*row), *(_cell(percent, rate.get(n)) for n in names)] for row, rate in rates.items()
    ]
    return markdown(["skills", *names], cells)


def _runs(conditions: Mapping[str, Any]) -> str:
    """What it took, and what happened on the way."""
    cells = []
    for name, one in conditions.items():
        steps, suite = one.get("steps"), next(iter(one.get("suites", {})), "")
        falls = _of(one, suite, "falls_per_1000_steps", "all")
        taken = steps if steps and steps["median"] else None
        cells.append(
            [
                name,
                _cell(percent, (one.get("coverage") or {}).get("cells")),
                _cell(lambda x: f"{x['median']:.1f}", falls),
                _cell(lambda x: f"{x['median']:,.0f}", taken),
            ]
        )
    return markdown(["run", "cells visited", "falls per 1,000 steps", "steps"], cells)


def _suites(conditions: Iterable[Mapping[str, Any]]) -> list[str]:
    """Names of the suites that some of them were measured on."""
    return list(dict.fromkeys(name for one in conditions for name in one.get("suites", {})))


def _of(one: Mapping[str, Any], suite: str, *names: str, by: str = "policy") -> Any:
    """The `summary` of what was measured on a suite; None where it was not."""
    found: Any = one
    for name in ("suites", suite, by, *names):
        found = found.get(name) if isinstance(found, Mapping) else None
    return found


def _planned(one: Mapping[str, Any]) -> bool:
    return any(_of(one, suite, "score", by="planning") for suite in _suites([one]))


def _title(name: str, by: str) -> str:
    return name if by == "policy" else f"{name}, planning"


def _cell(written: Callable[[Mapping[str, Any]], str], one: Mapping[str, Any] | None) -> str:
    return written(one) if one else NONE
