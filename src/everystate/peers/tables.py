"""The main numbers of a comparison as tables of Markdown."""

from collections.abc import Mapping
from typing import Any

from everystate.evaluation.markdown import markdown, percent, percent_interval


def table(result: Mapping[str, Any]) -> str:
    """A row per agent, and one more for ours with planning: the median over seeds, in per cent.

    Goals count within 0.5 σ at the last step where nothing else is said. Beside the success over
    all goals stands the 90 % interval of its interquartile mean. Skills have a table of their own.
    """
    regions = [name for name in next(iter(result["agents"].values()))["success"] if name != "all"]
    steps = f"{result['equal_steps']:,}"
    heads = [
        "agent",
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
    rows = [_row(name, agent, "success", regions) for name, agent in result["agents"].items()]
    rows += [
        _row(f"{name}, planning", agent, "success_plan", regions)
        for name, agent in result["agents"].items()
        if agent.get("success_plan")
    ]
    return markdown(heads, rows) + _skills(result["agents"])


def _skills(agents: Mapping[str, Any]) -> str:
    """Starts from which each skill succeeded; nothing where the body has none."""
    rows = {name: agent.get("skills") for name, agent in agents.items()}
    rows |= {f"{name}, planning": agent.get("skills_plan") for name, agent in agents.items()}
    measured = {name: skills for name, skills in rows.items() if skills}
    if not measured:
        return ""
    names = list(next(iter(measured.values())))
    cells = [[name, *(percent(skills[n]) for n in names)] for name, skills in measured.items()]
    return "\n" + markdown(["skills", *names], cells)


def _row(name: str, agent: Mapping[str, Any], which: str, regions: list[str]) -> list[str]:
    policy = which == "success"
    success = {region: agent[which][region]["0.5"] for region in [*regions, "all"]}
    every = success["all"]["last"]
    equal = agent["at_equal_steps"].get("all") if policy else None
    cells = (agent.get("coverage") or {}).get("cells")
    return [
        name,
        *(percent(success[region]["last"]) for region in regions),
        percent_interval(every),
        percent(agent[which]["all"]["1"]["last"]),
        percent(success["all"]["any"]),
        percent(agent["position_only"]["all"]["0.5"]["last"]) if policy else "",
        percent(equal) if equal else "",
        percent(cells) if cells and policy else "",
        f"{agent['falls_per_1000_steps']['median']:.1f}" if policy else "",
        f"{agent['steps']['median']:,.0f}" if policy else "",
    ]
