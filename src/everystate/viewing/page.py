"""The HTML of a report: one file with its pictures inside, which asks the network for nothing."""

import html
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from everystate.evaluation.metrics import EPS

NEAR = {"max": "in every component", "rms": "by the root mean square of the components"}
VERBS = {"end": ("holds", "held at the last step"), "hit": ("passes", "passed at some step")}
"""Of each reading, what the agent does to a goal, and what is done to the goal."""
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1b1b1b; background: #fff;
       max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0; } h2 { font-size: 1.15rem; margin: 2.2rem 0 .3rem; }
.verdict { font-size: 1.15rem; border-left: 4px solid #0072B2; padding: .4rem .8rem;
           background: #eef5fa; }
.sub, figcaption, .note { color: #555; font-size: .92rem; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .25rem .8rem; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; }
figure { margin: 0; } img { max-width: 100%; height: auto; display: block; }
.note { border-left: 4px solid #E69F00; padding: .4rem .8rem; background: #faf6ec; }
pre { overflow-x: auto; background: #f5f5f5; padding: .8rem; font-size: .82rem; }
@media print { h2, figure { break-inside: avoid; } h2 { break-after: avoid; } }
"""


class Shown(NamedTuple):
    """A picture as it stands on the page; without data only its caption appears."""

    title: str
    caption: str
    source: str | None
    """The picture, as a data URL."""


def page(name: str, result: Mapping[str, Any], pictures: Sequence[Shown]) -> str:
    """The whole page."""
    title = html.escape(f"{name}: {result['body']}")
    parts = [
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{_STYLE}</style></head><body>",
        f"<h1>{html.escape(result['body'])}</h1>",
        f'<p class="sub">Run {html.escape(name)}</p>',
        f'<p class="verdict">{html.escape(verdict(result))}</p>',
        *map(_figure, pictures[:1]),
        *(
            _table(suite, name, result["references"].get(name, {}))
            for name, suite in result["suites"].items()
        ),
        _coverage(result),
        *map(_figure, pictures[1:]),
        "<h2>Where this comes from</h2>",
        f"<pre>{html.escape(_origin(result))}</pre>",
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def scored_by(suite: Mapping[str, Any]) -> tuple[str, str]:
    """Measure and reading of a suite's score."""
    measure, reading = suite["scored_by"].removesuffix("@0.5").split(", ")
    return measure, reading


def verdict(result: Mapping[str, Any]) -> str:
    """What the agent reaches, beside what has learned nothing."""
    told = []
    for name, suite in result["suites"].items():
        measure, reading = scored_by(suite)
        planned, beside = suite["planning"], result["references"].get(name, {})
        others = [("with planning", planned)] if planned else []
        others += list(beside.items())
        told.append(
            f"{VERBS[reading][0]} {_percent(suite['policy'])} of {suite['tasks']} goals"
            f" {'at rest' if name == 'rest' else 'in motion' if name == 'motion' else name},"
            f" within 0.5 σ {NEAR[measure]}"
            + (" ({})" if others else "").format(
                ", ".join(f"{what} {_percent(one)}" for what, one in others)
            )
        )
    return f"By its policy it {'; and it '.join(told)}."


def _percent(measured: Mapping[str, Any], group: str = "all") -> str:
    return f"{100 * measured['score'][group]:.0f} %"


def _figure(picture: Shown) -> str:
    title, caption = html.escape(picture.title), html.escape(picture.caption)
    if picture.source is None:
        return f'<h2>{title}</h2>\n<p class="note">{caption}</p>'
    return (
        f'<h2>{title}</h2>\n<figure><img alt="{title}" src="{picture.source}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _table(suite: Mapping[str, Any], name: str, references: Mapping[str, Any]) -> str:
    policy, planning = suite["policy"], suite["planning"]
    heads = ["goals", *(f"end @{eps:g}" for eps in EPS), "hit @0.5", "rms hit @0.5"]
    heads += ["position only, end @0.5", "nearest, rms σ"]
    heads += ["planning, end @0.5", "hit @0.5"] if planning else []
    heads += [f"{what}, {suite['scored_by'].split(', ')[1]}" for what in references]
    rows = []
    for group, row in policy["success"]["max"].items():
        cells = [row[f"{eps:g}"]["end"] for eps in EPS]
        cells += [row["0.5"]["hit"], policy["success"]["rms"][group]["0.5"]["hit"]]
        cells += [policy["position_only"][group]["0.5"]["end"]]
        texts = [f"{100 * cell:.0f} %" for cell in cells]
        texts.append(f"{policy['closest'][group]['nearest']:.2f}")
        if planning:
            planned = planning["success"]["max"][group]["0.5"]
            texts += [f"{100 * planned[reading]:.0f} %" for reading in ("end", "hit")]
        texts += [_percent(one, group) for one in references.values()]
        numbers = "".join(f"<td>{text}</td>" for text in texts)
        rows.append(f"<tr><td>{html.escape(group)}</td>{numbers}</tr>")
    head = "".join(f"<th>{head}</th>" for head in heads)
    return (
        f"<h2>Goals reached, suite {html.escape(name)}</h2><p>{html.escape(suite['notes'])}</p>"
        f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
        f"<p>{html.escape(_sentence(policy))}</p>"
    )


def _sentence(policy: Mapping[str, Any]) -> str:
    """The numbers that are no shares of goals."""
    falls = policy["falls_per_1000_steps"]["all"]
    told = [f"{falls:.1f} falls per 1,000 steps of the evaluation"]
    calibration = policy["calibration"]
    if calibration["mae"] is not None:
        told.append(
            f"−V is off by {calibration['mae']:.1f} steps on average over the"
            f" {calibration['reached']} goals that it came within 0.25 σ of"
        )
    if calibration["spearman"] is not None:
        told.append(
            f"its rank correlation with the measured steps is {calibration['spearman']:.2f}"
        )
    return "; ".join(told) + "."


def _coverage(result: Mapping[str, Any]) -> str:
    cells = (result["coverage"] or {}).get("cells")
    return "" if cells is None else f"<p>Training visited {100 * cells:.0f} % of all cells.</p>"


def _origin(result: Mapping[str, Any]) -> str:
    machine, versions = result["machine"], result["versions"]
    lines = {
        "command": result["command"],
        "commit": result["commit"] or "unknown",
        "machine": ", ".join(f"{name} {value}" for name, value in machine.items()),
        "versions": ", ".join(f"{name} {value}" for name, value in versions.items()),
        "evaluation seed": result["seed"],
        "seconds": result["time"]["seconds"],
        "config": ", ".join(f"{name} {value}" for name, value in result["config"].items()),
    }
    return "\n".join(f"{name}: {value}" for name, value in lines.items())
