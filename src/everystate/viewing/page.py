"""The HTML of a report: one file with its pictures inside, which asks the network for nothing."""

import html
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from everystate.evaluation.metrics import EPS

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1b1b1b; background: #fff;
       max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0; } h2 { font-size: 1.15rem; margin: 2.2rem 0 .3rem; }
.sub, figcaption, .note { color: #555; font-size: .92rem; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .25rem .8rem; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; }
figure { margin: 0; } img { width: 100%; height: auto; }
.note { border-left: 4px solid #E69F00; padding: .4rem .8rem; background: #faf6ec; }
pre { overflow-x: auto; background: #f5f5f5; padding: .8rem; font-size: .82rem; }
@media print { h2, figure { break-inside: avoid; } h2 { break-after: avoid; } }
"""


class Shown(NamedTuple):
    """A picture as it stands on the page; without data only its caption appears."""

    title: str
    caption: str
    png: str | None
    """The picture, in base64."""


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
        *(_table(suite, name) for name, suite in result["suites"].items()),
        _coverage(result),
        *map(_figure, pictures),
        "<h2>Where this comes from</h2>",
        f"<pre>{html.escape(_origin(result))}</pre>",
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _figure(picture: Shown) -> str:
    title, caption = html.escape(picture.title), html.escape(picture.caption)
    if picture.png is None:
        return f'<h2>{title}</h2>\n<p class="note">{caption}</p>'
    return (
        f'<h2>{title}</h2>\n<figure><img alt="{title}" src="data:image/png;base64,{picture.png}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _table(suite: Mapping[str, Any], name: str) -> str:
    policy, planning = suite["policy"], suite["planning"]
    heads = ["goals", *(f"end @{eps:g}" for eps in EPS), "hit @0.5", "rms hit @0.5"]
    heads += ["position only, end @0.5", "nearest, rms σ"]
    heads += ["planning, end @0.5", "hit @0.5"] if planning else []
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
        numbers = "".join(f"<td>{text}</td>" for text in texts)
        rows.append(f"<tr><td>{html.escape(group)}</td>{numbers}</tr>")
    head = "".join(f"<th>{head}</th>" for head in heads)
    return (
        f"<h2>Suite {html.escape(name)}</h2><p>{html.escape(suite['notes'])}</p>"
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
