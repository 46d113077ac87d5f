"""The main numbers of a comparison as a table of Markdown."""

from collections.abc import Mapping
from typing import Any

from everystate.evaluation.markdown import markdown, percent, percent_interval


def table(result: Mapping[str, Any]) -> str:
    """A row per agent, and one more for ours with planning: the median over seeds, in per cent.

    Beside the success over all goals stands the 90 % interval of its interquartile mean.
    """
    regions = [name for name in next(iter(result["agents"].values()))["success"] if name != "all"]
    steps = f"{result['equal_steps']:,}"
    heads = [
        "agent",
        *regions,
        "all goals",
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
    return markdown(heads, rows)


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
        percent(success["all"]["any"]),
        percent(agent["position_only"]["all"]["0.5"]["last"]) if policy else "",
        percent(equal) if equal else "",
        percent(cells) if cells and policy else "",
        f"{agent['falls_per_1000_steps']['median']:.1f}" if policy else "",
        f"{agent['steps']['median']:,.0f}" if policy else "",
    ]
