"""What a sweep found, from the files in its folder alone."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from everystate.agent.files import read_json
from everystate.evaluation.aggregate import over_seeds
from everystate.evaluation.markdown import markdown, percent, percent_interval
from everystate.scaling.plan import Sweep
from everystate.scaling.trial import finished
from everystate.training.rundir import write_atomically

Groups = Mapping[str, Sequence[Path]]
"""Folders of finished runs, by setting."""


def write(plan: Sweep, out: Path) -> str:
    """Writes summary.json, table.md and the figures; returns the table.

    With settings, that is a row for each: medians over seeds, and beside the success over all goals
    the 90 % interval of its interquartile mean. Of a search, a row for each run, best first.
    """
    if plan.search:
        return _write_search(plan, out)
    tables = []
    summaries: dict[str, Any] = {}
    for body in plan.bodies:
        groups = _groups(out, plan.groups(body))
        if groups:
            summaries |= {name: _summary(folders) for name, folders in groups.items()}
            tables.append(table({name: summaries[name] for name in groups}))
            name = Path(body).stem if len(plan.bodies) > 1 else "success"
            _draw(groups, out / f"{name}.png")
    write_atomically(out / "summary.json", json.dumps(summaries, indent=1) + "\n")
    text = "\n".join(tables)
    write_atomically(out / "table.md", text)
    return text


def table(summaries: Mapping[str, Any]) -> str:
    """Settings of one body, in per cent: the score on each suite, by the policy.

    The first suite is told by group too; all of it with the 90 % interval.
    """
    first = next(iter(summaries.values()))["suites"]
    groups = [group for group in next(iter(first.values()))["policy"]["score"] if group != "all"]
    planned = any(_planned(one) for one in summaries.values())
    skilled = any(one.get("skills") for one in summaries.values())
    heads = ["setting", "seeds", *groups, *first]
    heads += [f"{name}, planning" for name in first] * planned
    heads += ["skills, mean"] * skilled + ["falls per 1,000 steps"]
    rows = []
    for name, one in summaries.items():
        by_suite = [suite["policy"] for suite in one["suites"].values()]
        cells = [name, str(len(one["seeds"]))]
        cells += [percent(by_suite[0]["score"][group]) for group in groups]
        cells += [percent_interval(policy["score"]["all"]) for policy in by_suite]
        if planned:
            cells += [percent(x) if x else "-" for x in _planned(one) or [None] * len(by_suite)]
        if skilled:
            skills = one.get("skills") or {}
            rates = [rate["median"] for rate in skills.get("policy", {}).values()]
            cells.append(f"{100 * sum(rates) / len(rates):.0f}" if rates else "-")
        falls = by_suite[0]["falls_per_1000_steps"]["all"]
        rows.append([*cells, f"{falls['median']:.1f}"])
    return markdown(heads, rows)


def _planned(one: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Scores by planning, suite by suite, if it was measured."""
    suites = one["suites"].values()
    return [suite["planning"]["score"]["all"] for suite in suites if suite.get("planning")]


def _write_search(plan: Sweep, out: Path) -> str:
    search = plan.search
    assert search is not None
    found = []
    for path in sorted(out.glob("trial-*/values.json")):
        if finished(path.parent):
            score = search.score(read_json(path.parent / "evaluation.json"))
            found.append({"run": path.parent.name, "score": score, "values": read_json(path)})
    found.sort(key=lambda one: -one["score"])
    heads = ["run", search.metric, *search.space]
    rows = []
    for one in found:
        values = [f"{x:.4g}" if isinstance(x, float) else str(x) for x in one["values"].values()]
        rows.append([one["run"], f"{one['score']:.3f}", *values])
    write_atomically(out / "summary.json", json.dumps(found, indent=1) + "\n")
    text = markdown(heads, rows)
    write_atomically(out / "table.md", text)
    return text


def _groups(out: Path, names: Sequence[str]) -> dict[str, list[Path]]:
    found = {name: [f for f in sorted((out / name).glob("seed*")) if finished(f)] for name in names}
    return {name: folders for name, folders in found.items() if folders}


def _summary(folders: Sequence[Path]) -> dict[str, Any]:
    return over_seeds([read_json(folder / "evaluation.json") for folder in folders])


def _draw(groups: Groups, path: Path) -> None:
    from everystate.viewing.figures import comparison, settings
    from everystate.viewing.plots import COLOURS

    # More curves could not be told apart.
    few = len(groups) <= len(COLOURS)
    figure = comparison(groups, over="epoch") if few else settings(groups)
    figure.savefig(path, dpi=150)
