"""The main numbers of a comparison as a table of Markdown."""

from collections.abc import Mapping
from typing import Any


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
    lines = ["| " + " | ".join(cells) + " |" for cells in [heads, ["---"] * len(heads), *rows]]
    return "\n".join(lines) + "\n"


def _row(name: str, agent: Mapping[str, Any], which: str, regions: list[str]) -> list[str]:
    policy = which == "success"
    success = {region: agent[which][region]["0.5"] for region in [*regions, "all"]}
    every = success["all"]["last"]
    equal = agent["at_equal_steps"].get("all") if policy else None
    cells = (agent.get("coverage") or {}).get("cells")
    return [
        name,
        *(_percent(success[region]["last"]) for region in regions),
        _percent(every) + _interval(every),
        _percent(success["all"]["any"]),
        _percent(agent["position_only"]["all"]["0.5"]["last"]) if policy else "",
        _percent(equal) if equal else "",
        _percent(cells) if cells and policy else "",
        f"{agent['falls_per_1000_steps']['median']:.1f}" if policy else "",
        f"{agent['steps']['median']:,.0f}" if policy else "",
    ]


def _percent(one: Mapping[str, Any]) -> str:
    return f"{100 * one['median']:.0f}"


def _interval(one: Mapping[str, Any]) -> str:
    return "" if one["low"] is None else f" [{100 * one['low']:.0f}, {100 * one['high']:.0f}]"
