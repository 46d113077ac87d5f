"""The table of one set of numbers on every body: python experiments/one_set.py measures them."""

import re
from collections import defaultdict
from statistics import median

from table_agents import percent
from table_cells import NONE, RESULTS, Rows, Run, at, middle, read, table, values

SUITES = {"at rest": "rest", "in motion": "motion"}
OTHERS = {"random actions": "random", "doing nothing": "nothing"}


@table
def one_set() -> Rows:
    """A row per body: medians over seeds and their range, and who does nothing or anything."""
    found: dict[str, list[Run]] = defaultdict(list)
    for path in sorted((RESULTS / "one-set").glob("*.json")):
        found[re.sub(r"-\d+$", "", path.stem)].append(read(f"one-set/{path.name}"))
    rows = [["body", "seeds", "minutes", *SUITES, "stands", *OTHERS]]
    for body, runs in found.items():
        score = "score", "all"
        cells = [_range(values(runs, "suites", x, "policy", *score)) for x in SUITES.values()]
        cells.append(_range(values(runs, "stands", "policy")))
        for other, short in OTHERS.items():
            every = [("suites", x, "references", other, *score) for x in SUITES.values()]
            shares = [values(runs, *names) for names in (*every, ("stands", short))]
            cells.append(", ".join(_middle(some) for some in shares))
        rows.append([body, f"{len(runs)}", middle(values(runs, "minutes"), times=1), *cells])
    return rows


@table
def parts() -> Rows:
    """A row per suite: the policy's readings within 0.5 σ, by how much is asked, and references."""
    numbers = range(1, 6)
    heads = ["body, suite", "end@0.5", "hit@0.5", *(f"{n} asked, score" for n in numbers)]
    rows = [[*heads, "random actions, score", "doing nothing, score"]]
    for path in sorted((RESULTS / "parts").glob("*.json")):
        run = read(f"parts/{path.name}")
        for name in run["suites"]:
            one = "suites", name, "policy"
            cells = [percent(at(run, *one, "success", "max", "all", "0.5", r)) for r in _READINGS]
            cells += [percent(at(run, *one, "score", f"{n} asked")) for n in numbers]
            for other in ("random actions", "doing nothing"):
                cells.append(percent(at(run, "suites", name, "references", other, "score", "all")))
            rows.append([f"{run['body']}, `{name}`", *cells])
    return rows


_READINGS = "end", "hit"


def _middle(shares: list[float]) -> str:
    return f"{100 * median(shares):.0f}" if shares else NONE


def _range(shares: list[float]) -> str:
    """The median, and the least and the most of several."""
    of_all = _middle(shares)
    if len(shares) < 2:
        return of_all
    least, most = 100 * min(shares), 100 * max(shares)
    return f"{of_all} ({least:.0f} to {most:.0f})"
