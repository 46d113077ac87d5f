"""Tables of agents beside others: by body, by skill, by kind of goal."""

import json
from collections.abc import Sequence

from table_cells import (
    HELD,
    NONE,
    PASSED,
    RESULTS,
    Rows,
    each,
    interval,
    middle,
    runs,
    table,
    values,
    worst,
)
from table_ramp import climbs

LOOK = "eval/success@0.5/all"
AGENTS = {
    "ours": "ours",
    "sac-her": "SAC with hindsight",
    "tqc-her": "TQC with hindsight",
    "random": "random actions",
}


def compared(study: str, agents: Sequence[str], regions: Sequence[str]) -> Rows:
    """A row per agent of a comparison, and one for ours with planning where that was measured."""
    found = {name: runs(f"compare/{study}/{name}") for name in agents}
    fewest = min(run["steps"] for of in found.values() for run in of if run["steps"])
    rows = [["agent", *regions, "all goals", "within 1 σ", "at any step", "position only",
             f"after {fewest:,} steps", "cells", "falls", "steps"]]  # fmt: skip
    for name, of in found.items():
        which = {"success": name, "success_plan": f"{name}, planning"}
        for success, title in which.items():
            reached = [values(of, success, region, *HELD) for region in [*regions, "all"]]
            if not reached[-1]:
                continue
            row = [title, *map(middle, reached[:-1]), interval(reached[-1])]
            row += [middle(values(of, success, "all", *x)) for x in (("1", "last"), PASSED)]
            if success == "success":
                early = [by(study, name, seed, fewest) for seed in range(len(of))]
                row += [middle(values(of, "position_only", "all", *HELD))]
                row += [middle([x for x in early if x is not None])]
                row += [middle(values(of, "coverage", "cells"))]
                row += [middle(values(of, "falls_per_1000_steps"), 1, 1)]
                row += [middle(values(of, "steps"), 1)]
            rows.append(row + [NONE] * (len(rows[0]) - len(row)))
    return rows


def by(study: str, name: str, seed: int, steps: int) -> float | None:
    """Goals held at the last look before so many control steps; None without one."""
    text = (RESULTS / f"compare/{study}/{name}/seed{seed}/metrics.jsonl").read_text()
    lines = [line for line in map(json.loads, text.splitlines()) if line["steps"] <= steps]
    return next((line[LOOK] for line in reversed(lines) if LOOK in line), None)


@table
def compare_ramp() -> Rows:
    """Ramp Pointmass, five seeds of ten minutes."""
    return compared("ramp-pointmass", list(AGENTS), ["floor", "ramp", "ledge"])


@table
def compare_cartpole() -> Rows:
    """Cartpole, three seeds of half an hour."""
    return compared("cartpole", list(AGENTS), ["hanging", "upright", "moving"])


@table
def compare_goals() -> Rows:
    """Our agent with the goals of others."""
    names = ("least-likely", "density", "visited", "skew-fit", "mega", "uniform")
    return compared("goals", [f"ours-{name}" for name in names], ["floor", "ramp", "ledge"])


def skills(body: str, columns: dict[str, tuple[str, str]], titles: dict[str, str]) -> Rows:
    """A row per skill, a column per agent: from how many starts it succeeded, by seed."""
    found = {title: runs(f"compare/{body}/{agent}") for title, (agent, _) in columns.items()}
    cells = {
        title: [each(values(found[title], which, skill)) for skill in titles]
        for title, (_, which) in columns.items()
    }
    return [["skill", *columns], *map(list, zip(titles.values(), *cells.values(), strict=True))]


POLICIES = {title: (agent, "skills") for agent, title in AGENTS.items()}


@table
def cartpole_skills() -> Rows:
    """Cartpole: starts from which each skill succeeded."""
    columns = {"ours": POLICIES["ours"], "ours, planning": ("ours", "skills_plan"), **POLICIES}
    titles = {
        "balance": "swing up and balance for 10 s",
        "spin-right": "spin right, 5 turns in 10 s",
        "spin-left": "spin left, 5 turns in 10 s",
        "hang-left": "hang still at x = -1",
        "hang-middle": "hang still at x = 0",
        "hang-right": "hang still at x = +1",
        "pass-top": "pass the top at 5 rad/s",
    }
    return skills("cartpole", columns, titles)


@table
def ant_skills() -> Rows:
    """Ant: starts from which each skill succeeded."""
    titles = {
        "recover": "recover: dropped in any orientation, upright and still",
        "flip": "flip: over, and back on its feet",
        "spin-left": "spin left",
        "spin-right": "spin right",
        "jump": "jump",
        "walk-forward": "walk forward at 0.5 m/s for 3 s",
        "walk-sideways": "walk sideways",
        "two-legs": "stand on two legs",
    }
    return skills("ant", {t: x for t, x in POLICIES.items() if x[0] != "tqc-her"}, titles)


@table
def ant_goals() -> Rows:
    """Ant: goals reached, by kind."""
    columns = [(name, eps) for eps in ("1", "0.5") for name in ("ours", "sac-her", "random")]
    found = {name: runs(f"compare/ant/{name}") for name, _ in columns}
    rows = [["of 500 goals", *(f"{AGENTS[name]}, {eps} σ" for name, eps in columns)]]
    for title, region, when in (
        ("at rest, upright: at the last step", "upright", "last"),
        ("at rest, upside down: at the last step", "upside down", "last"),
        ("in motion: at any step", "moving", "any"),
        ("all: at the last step", "all", "last"),
    ):
        cells = [each(values(found[n], "success", region, eps, when)) for n, eps in columns]
        rows.append([title, *cells])
    return rows


@table
def whole_states() -> Rows:
    """Per cent of goals: the median over seeds, and the worst seed."""
    rows = [["goals", *AGENTS.values()]]
    for title, body, regions, reading in (
        ("Ramp: all, held within 0.5 σ", "ramp-pointmass", ["all"], HELD),
        ("Cartpole, at rest: held within 0.5 σ", "cartpole", ["hanging", "upright"], HELD),
        ("Cartpole, in motion: passed within 0.5 σ", "cartpole", ["moving"], PASSED),
        ("Ant, at rest: held within 1 σ", "ant", ["upright", "upside down"], ("1", "last")),
        ("Ant, in motion: passed within 1 σ", "ant", ["moving"], ("1", "any")),
    ):
        row = [title]
        for agent in AGENTS:
            of = [values(runs(f"compare/{body}/{agent}"), "success", r, *reading) for r in regions]
            row.append(worst([sum(x) / len(x) for x in zip(*of, strict=True)]))  # as many of each
        rows.append(row)
    for title, setting in (("worst", "pessimal-of-20"), ("mean", "mean-of-20")):
        falls = values(climbs(setting), "west", "falls")
        named = f"Ramp: falls on climbs round a corner, by the {title} of 20 outcomes"
        rows.append([named, worst(falls, max, ".3g"), NONE, NONE, NONE])
    return rows
