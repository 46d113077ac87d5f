"""Table of the benchmark's environments: what each asks, and what is had without learning.

Random actions and doing nothing were measured by `everystate compare`, search through MuJoCo by
`python tools/ceilings.py BODY SUITE`.
"""

from table_agents import SEARCH, percent
from table_cells import NONE, RESULTS, Rows, at, read, table

from everystate import envs
from everystate.benchmark.environments import ENVIRONMENTS
from everystate.evaluation import suite_file, suites
from everystate.evaluation.suite import Suite

_SHOWN = 12
"""Digits of a checksum: enough to tell files apart."""
_OTHERS = {"random actions": "random", "doing nothing": "nothing"}


def score(path: str, suite: Suite) -> str:
    """Of a raw result, which must be of this very suite."""
    if not (RESULTS / path).exists():
        return NONE
    found = read(path)["suites"][suite.name]
    if found["checksum"] != suite_file.checksum(suite_file.as_json(suite)):
        raise SystemExit(f"{path} was measured on another suite: measure it again")
    return percent(at(found, "policy", "score", "all"))


@table
def environments() -> Rows:
    """A row per environment."""
    heads = ["environment", "state", "actions", "steps", "told by", *_OTHERS, SEARCH]
    rows = [[*heads, "`report`", "`tune`"]]
    for id, (body, name) in ENVIRONMENTS.items():
        env = envs.make(body, 1, 0)
        of = {split: suites.load(body, name, split=split) for split in ("report", "tune")}
        suite = of["report"]
        steps = sorted({int(suite.horizons.min()), int(suite.horizons.max())})
        cells = [f"`{id}`", str(len(env.state_names)), str(len(env.action_names))]
        cells += [" to ".join(map(str, steps)), "{1}@0.5, {0}".format(*suite.scored_by)]
        for agent in _OTHERS.values():
            cells.append(score(f"peers/{body}/{agent}/seed0/evaluation.json", suite))
        cells.append(score(f"suites/{body}-{name}-search.json", suite))
        sums = (suite_file.checksum(suite_file.as_json(one))[:_SHOWN] for one in of.values())
        rows.append([*cells, *(f"`{one}`" for one in sums)])
    return rows
