"""The main numbers of a comparison as tables of Markdown."""

from collections.abc import Callable, Mapping
from typing import Any

from everystate.evaluation.markdown import markdown, percent, percent_interval
from everystate.peers import reading

NONE = "—"
_CAPTION = (
    f"{NONE}: not measured. Who does not learn takes no steps and visits no cells; cells are told"
    " for bodies of up to three dimensions; skills where a body has any; what is told after equal"
    " steps is of the policy and of the other split of the goals, which is looked at in training.\n"
)


def table(result: Mapping[str, Any]) -> str:
    """A table for each suite, one of the skills, one of the runs: medians over seeds, in per cent.

    A row per agent, and one more for ours with planning. Beside the score over all goals of a suite
    stands the 90 % interval of its interquartile mean. No agent is left out: what was not measured
    is a dash, and below the tables stands why.
    """
    agents = result["agents"]
    rows = {(name, "policy"): one for name, one in agents.items()}
    rows |= {(name, "planning"): one for name, one in agents.items() if reading.planned(one)}
    parts = [_suite(result, rows, suite) for suite in reading.suites(list(agents.values()))]
    parts += [_skills(rows), _runs(agents)]
    text = "\n".join(part for part in parts if part) + "\n" + _CAPTION
    missing = [name for name, agent in agents.items() if not agent["seeds"]]
    if missing:
        text += f"\nNo run of {', '.join(missing)} was finished.\n"
    return text


_Rows = Mapping[tuple[str, str], Mapping[str, Any]]


def _suite(result: Mapping[str, Any], rows: _Rows, suite: str) -> str:
    """Scores by group, and what is beside the score over all."""
    groups = reading.groups(list(rows.values()), suite)
    steps = f"{result['equal_steps']:,}"
    heads = [suite, "seeds", *groups, "all", "end @1", "hit @0.5", "rms hit @0.5", "position only"]
    heads += ["nearest, rms σ", f"all, after {steps} steps"]
    cells = []
    for (name, by), one in rows.items():

        def of(*names: str, one: Mapping[str, Any] = one, by: str = by) -> Any:
            return reading.of(one, suite, *names, by=by)

        equal = one.get("at_equal_steps", {}).get(f"{suite}/all") if by == "policy" else None
        cells.append(
            [
                _title(name, by),
                f"{len(one['seeds'])}",
                *(_cell(percent, of("score", group)) for group in groups),
                _cell(percent_interval, of("score", "all")),
                _cell(percent, of("success", "max", "all", "1", "end")),
                _cell(percent, of("success", "max", "all", "0.5", "hit")),
                _cell(percent, of("success", "rms", "all", "0.5", "hit")),
                _cell(percent, of("position_only", "all", "0.5", "end")),
                _cell(lambda x: f"{x['median']:.2f}", of("closest", "all", "nearest")),
                _cell(percent, equal),
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


def _runs(agents: Mapping[str, Any]) -> str:
    """What it took, and what happened on the way."""
    cells = []
    for name, one in agents.items():
        steps = one.get("steps")
        suite = next(iter(one.get("suites", {})), "")
        cells.append(
            [
                name,
                _cell(percent, (one.get("coverage") or {}).get("cells")),
                _cell(
                    lambda x: f"{x['median']:.1f}",
                    reading.of(one, suite, "falls_per_1000_steps", "all"),
                ),
                _cell(
                    lambda x: f"{x['median']:,.0f}", steps if steps and steps["median"] else None
                ),
            ]
        )
    return markdown(["run", "cells visited", "falls per 1,000 steps", "steps"], cells)


def _title(name: str, by: str) -> str:
    return name if by == "policy" else f"{name}, planning"


def _cell(written: Callable[[Mapping[str, Any]], str], one: Mapping[str, Any] | None) -> str:
    return written(one) if one else NONE
