"""Summaries over seeds as tables of Markdown."""

from collections.abc import Mapping, Sequence
from typing import Any


def percent(one: Mapping[str, Any]) -> str:
    """The median of a `summary`, in per cent."""
    return f"{100 * one['median']:.0f}"


def percent_interval(one: Mapping[str, Any]) -> str:
    """The same, and the interval of the interquartile mean, if there are seeds enough for one."""
    if one["low"] is None:
        return percent(one)
    return f"{percent(one)} [{100 * one['low']:.0f}, {100 * one['high']:.0f}]"


def markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with these headings."""
    every = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in every) + "\n"
