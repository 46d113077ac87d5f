"""The main numbers of a comparison as tables of Markdown."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from everystate.evaluation.markdown import markdown, percent, percent_interval
from everystate.peers import reading

NONE = "—"
_CAPTION = (
    f"{NONE}: not measured. Who does not learn takes no steps and visits no cells; cells are told"
    " for bodies of up to three dimensions; falls, cells and steps are those of the policy, not of"
    " planning.\n"
)


def table(result: Mapping[str, Any]) -> str:
    """A row per agent, and one more for ours with planning: the median over seeds, in per cent.

    Goals count within 0.5 σ at the last step where nothing else is said. Beside the success over
    all goals stands the 90 % interval of its interquartile mean. Skills have a table of their own.
    No agent is left out: what was not measured is a dash, and below the table stands why.
    """
    agents = result["agents"]
    regions = list(
        dict.fromkeys(r for one in agents.values() if one["seeds"] for r in reading.regions(one))
    )
    steps = f"{result['equal_steps']:,}"
    heads = [
        "agent",
        "seeds",
        *regions,
        "all goals",
        "all, within 1 σ",
        "all, at any step",
        "all, position only",
        f"all, after {steps} steps",
        "cells visited",
        "falls per 1,000 steps",
        "steps",
    ]
    rows = [_row(name, agent, regions) for name, agent in agents.items()]
    rows += [
        _row(f"{name}, planning", agent, regions, planning=True)
        for name, agent in agents.items()
        if agent.get("success_plan")
    ]
    text = markdown(heads, rows)
    if any(NONE in row for row in rows):
        text += "\n" + _CAPTION
    missing = [name for name, agent in agents.items() if not agent["seeds"]]
    if missing:
        text += f"\nNo run of {', '.join(missing)} was finished.\n"
    return text + _skills(agents)


def _skills(agents: Mapping[str, Any]) -> str:
    """Starts from which each skill succeeded; nothing where the body has none."""
    rows = {name: agent.get("skills") for name, agent in agents.items()}
    rows |= {
        f"{name}, planning": agent.get("skills_plan")
        for name, agent in agents.items()
        if agent.get("success_plan")
    }
    names = list(dict.fromkeys(n for skills in rows.values() if skills for n in skills))
    if not names:
        return ""
    cells = [
        [name, *(_cell(percent, (skills or {}).get(n)) for n in names)]
        for name, skills in rows.items()
    ]
    text = "\n" + markdown(["skills", *names], cells)
    if any(NONE in row for row in cells):
        text += f"\n{NONE}: its skills were not measured.\n"
    return text


def _row(
    name: str, agent: Mapping[str, Any], regions: Sequence[str], *, planning: bool = False
) -> list[str]:
    which = "success_plan" if planning else "success"
    policy = {} if planning else agent
    steps = policy.get("steps")
    return [
        name,
        f"{len(agent['seeds'])}",
        *(_cell(percent, reading.rate(agent, region, which=which)) for region in regions),
        _cell(percent_interval, reading.rate(agent, which=which)),
        _cell(percent, reading.rate(agent, eps="1", which=which)),
        _cell(percent, reading.rate(agent, last=False, which=which)),
        _cell(percent, reading.rate(policy, which="position_only")),
        _cell(percent, policy.get("at_equal_steps", {}).get("all")),
        _cell(percent, (policy.get("coverage") or {}).get("cells")),
        _cell(lambda x: f"{x['median']:.1f}", policy.get("falls_per_1000_steps")),
        _cell(lambda x: f"{x['median']:,.0f}", steps if steps and steps["median"] else None),
    ]


def _cell(written: Callable[[Mapping[str, Any]], str], one: Mapping[str, Any] | None) -> str:
    return written(one) if one else NONE
