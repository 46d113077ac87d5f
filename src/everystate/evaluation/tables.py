"""Results as they are printed on a terminal, at most 80 columns wide."""

from collections.abc import Iterator, Mapping
from typing import Any

from rich.table import Table

from everystate.evaluation import metrics
from everystate.evaluation.perturbations import GRID


def tables(result: Mapping[str, Any]) -> Iterator[Table]:
    """All tables of an `evaluate` result, one after the other."""
    for name in result["suites"]:
        yield suite_table(result, name)
        if result["suites"][name].get("references"):
            yield beside_table(result, name)
    if result["skills"]:
        yield skills_table(result)
    if result["perturbed"]:
        yield perturbed_table(result)


def suite_table(result: Mapping[str, Any], name: str) -> Table:
    """Of one suite: a row for each kind and k, and for all."""
    suite = result["suites"][name]
    policy, planning = suite["policy"], suite["planning"]
    split = " to tune by" if suite["split"] == "tune" else ""
    shown = Table(title=f"{result['body']}, suite {name}, {suite['tasks']} tasks{split}")
    shown.add_column("goals")
    for eps in metrics.EPS:
        shown.add_column(f"end\n@{eps:g}", justify="right")
    shown.add_column("hit\n@0.5", justify="right")
    shown.add_column("hit\nrms", justify="right")
    shown.add_column("near\nrms", justify="right")
    if planning:
        shown.add_column("plan\nend", justify="right")
        shown.add_column("plan\nhit", justify="right")
    for group, row in policy["success"]["max"].items():
        if group == "all":
            shown.add_section()
        cells = [row[f"{eps:g}"]["end"] for eps in metrics.EPS]
        cells += [row["0.5"]["hit"], policy["success"]["rms"][group]["0.5"]["hit"]]
        texts = [f"{100 * cell:.0f} %" for cell in cells]
        texts.append(f"{policy['closest'][group]['nearest']:.2f} σ")
        if planning:
            planned = planning["success"]["max"][group]["0.5"]
            texts += [f"{100 * planned[r]:.0f} %" for r in ("end", "hit")]
        shown.add_row(group, *texts)
    steps_off = policy["calibration"]["mae"]
    falls = policy["falls_per_1000_steps"]["all"]
    shown.caption = f"within so many σ, else 0.5; {falls:.1f} falls per 1,000 steps" + (
        "" if steps_off is None else f"; -V is off by {steps_off:.1f} steps on average"
    )
    return shown


def beside_table(result: Mapping[str, Any], name: str) -> Table:
    """The readings over all tasks of one suite, beside those of what learned nothing."""
    suite = result["suites"][name]
    measure, reading = suite["scored_by"].removesuffix("@0.5").split(", ")
    shown = Table(caption=f"within 0.5 σ by {measure}; scored by {reading}")
    for heading in ("all goals", "hit", "end", "at"):
        shown.add_column(heading, justify="left" if heading == "all goals" else "right")
    for title, one in {"recorded": suite["policy"], **suite["references"]}.items():
        found = one["success"][measure]["all"]["0.5"]
        shown.add_row(title, *(f"{100 * found[r]:.0f} %" for r in ("hit", "end", "at")))
    return shown


def skills_table(result: Mapping[str, Any]) -> Table:
    """The shares of starts from which the named skills succeeded."""
    skills = result["skills"]
    few = skills.get("starts_of_parts")  # older results have none
    asked_whole = f"of {skills['starts']} starts"
    caption = f"{asked_whole}, or {few} where it asks for parts of a state" if few else asked_whole
    shown = Table(title="Named skills", caption=caption)
    shown.add_column("skill")
    ways = [way for way in ("policy", "planning") if skills[way]]
    for heading in ways:
        shown.add_column(heading, justify="right")
    for name in skills["policy"]:
        shown.add_row(name, *(f"{100 * skills[way][name]:.0f} %" for way in ways))
    return shown


def perturbed_table(result: Mapping[str, Any]) -> Table:
    """Success over all goals in the worlds of the perturbation grid."""
    first = next(iter(result["suites"]))
    shown = Table(title=f"Other masses, motors and noise, {len(GRID)} worlds, suite {first}")
    shown.add_column("end@0.5")
    names = {"nominal": "as trained", "mean": "mean", "cvar10": "worst tenth", "worst": "worst"}
    for heading in names.values():
        shown.add_column(heading, justify="right")
    for way, found in result["perturbed"].items():
        if found:
            shown.add_row(way, *(f"{100 * found[name]:.1f} %" for name in names))
    return shown
