"""Tables of agents that come along, beside peers, no action, random actions and search.

One seed each. Ours are those of `python experiments/one_set.py`, and their planning, which takes
long, is measured on fewer tasks: `everystate evaluate BODY --plan --episodes 40 --out
results/agents/BODY-planning.json`. Others are measured by `everystate compare ... --out
results/peers/BODY`, what search through MuJoCo finds by `python tools/ceilings.py BODY motion`.
"""

from functools import partial
from typing import Any

from table_cells import NONE, RESULTS, TABLES, Rows, Run, at, middle, read, table, values
from table_ramp import climbs

from everystate.evaluation import suites

BODIES = {"ramp-pointmass": "Ramp", "cartpole": "Cartpole", "ant": "Ant"}
PEERS = {
    "sac-her-zoo": "SAC+HER, zoo",
    "sac-her": "SAC+HER, 50 bodies",
    "sac-her-no-reset": "SAC+HER, 50 bodies, no resets",
    "tqc-her-zoo": "TQC+HER, zoo",
    "random": "random actions",
    "nothing": "doing nothing",
}
SEARCH = "search through MuJoCo"


def agents(body: str) -> dict[str, tuple[Run, str]]:
    """Results of a body by the name of the row, and under which key they are its."""
    ours, planning = _found(f"one-set/{body}-0.json"), _found(f"agents/{body}-planning.json")
    rows = {"ours": (ours, "policy"), "ours, planning": (planning, "planning")}
    for name, title in PEERS.items():
        rows[title] = (_found(f"peers/{body}/{name}/seed0/evaluation.json"), "policy")
    search = _found(f"suites/{body}-motion-search.json")
    return rows | ({SEARCH: (search, "policy")} if search else {})


def _found(path: str) -> Run:
    return read(path) if (RESULTS / path).exists() else {}


def _names(run: Run, *path: str) -> list[str]:
    """Keys of a branch of a result; none where it has no such branch."""
    found: Any = at(run, *path)
    return list(found or {})


def percent(value: float | None) -> str:
    """A share; a dash where nothing was measured."""
    return NONE if value is None else f"{100 * value:.0f}"


def _number(value: float | None) -> str:
    return NONE if value is None else f"{value:.2f}"


def suite(body: str, name: str) -> Rows:
    """A row per agent: the score by group, and what stands beside it."""
    rows = agents(body)
    groups = _names(rows["ours"][0], "suites", name, "policy", "score")
    if name == "motion":
        groups = [group for group in groups if group.startswith("k=")] + ["all"]
    beside = {
        "rest": {"end@0.25": ("max", "0.25", "end"), "end@1": ("max", "1", "end")},
        "motion": {
            "hit@0.5, max": ("max", "0.5", "hit"),
            "hit@1, max": ("max", "1", "hit"),
            "hit@0.5, rms": ("rms", "0.5", "hit"),
        },
    }[name]
    nearest = {"nearest": "nearest", "pose": "pose", "velocity": "velocity"}
    found = [["", *groups, *beside, *nearest]]
    for title, (run, by) in rows.items():

        def of(*names: str, run: Run = run, by: str = by) -> float | None:
            return at(run, "suites", name, by, *names)

        if of("score", "all") is None and title == SEARCH:
            continue  # it was asked of motion alone
        cells = [percent(of("score", group)) for group in groups]
        cells += [percent(of("success", m, "all", eps, r)) for m, eps, r in beside.values()]
        cells += [_number(of("closest", "all", part)) for part in nearest.values()]
        found.append([title, *cells])
    return found


def skills(body: str) -> Rows:
    """A row per skill, a column per agent."""
    rows = {title: row for title, row in agents(body).items() if title != SEARCH}
    names = _names(rows["ours"][0], "skills", "policy")
    cells = [
        [name, *(percent(at(run, "skills", by, name)) for run, by in rows.values())]
        for name in names
    ]
    return [["skill", *rows], *cells]


for _body in BODIES:
    TABLES[f"{_body}-skills"] = partial(skills, _body)
    for _name in suites.names(_body):
        TABLES[f"{_body}-{_name}"] = partial(suite, _body, _name)


@table
def whole_states() -> Rows:
    """Per cent of goals, and of climbs that fall."""
    found = {body: agents(body) for body in BODIES}
    titles = [title for title in found["cartpole"] if title != SEARCH]
    rows = [["goals", *titles, SEARCH]]
    for text, body, name, group in (
        ("Ramp, at rest", "ramp-pointmass", "rest", "all"),
        ("Cartpole, hanging at rest", "cartpole", "rest", "hanging"),
        ("Cartpole, upright at rest", "cartpole", "rest", "upright"),
        ("Cartpole, in motion", "cartpole", "motion", "all"),
        ("Ant, at rest", "ant", "rest", "all"),
        ("Ant, in motion", "ant", "motion", "all"),
    ):
        row = [text]
        for title in [*titles, SEARCH]:
            run, by = found[body].get(title, ({}, "policy"))
            row.append(percent(at(run, "suites", name, by, "score", group)))
        rows.append(row)
    for text, setting in (("worst", "pessimal-of-20"), ("mean", "mean-of-20")):
        falls = values(climbs(setting), "west", "falls")
        named = f"Ramp: climbs round a corner that fall, by the {text} of 20 outcomes (10 seeds)"
        rows.append([named, middle(falls, digits=2), *[NONE] * len(titles)])
    return rows


@table
def paper() -> Rows:
    """The paper's own settings at its own sizes: scores on the ramp while it trains."""
    rows = [["run", "epochs", *(f"epoch {epoch}" for epoch in range(10, 101, 10)), "floor", "ramp"]]
    rows[0] += ["ledge", "climb", "falls"]
    for path in sorted((RESULTS / "paper").glob("*.json")):
        run = read(f"paper/{path.name}")
        curve = next((run["curves"][n] for n in LOOKS if n in run["curves"]), [])
        looks = [curve[epoch - 1] if epoch <= len(curve) else None for epoch in range(10, 101, 10)]
        broke = run["broke_in_epoch"]
        epochs = f"breaks down in epoch {broke}" if broke else f"{run['epochs']}"
        cells = [path.stem, epochs, *map(percent, looks)]
        rest = ("suites", "rest", "policy")
        cells += [percent(at(run, *rest, "score", x)) for x in ("floor", "ramp", "ledge")]
        cells += [percent(at(run, "skills", "policy", "climb"))]
        falls = at(run, *rest, "falls_per_1000_steps", "all")
        rows.append([*cells, NONE if falls is None else f"{falls:.1f}"])
    return rows


LOOKS = ("eval/rest/score/all", "eval/success@0.5/all")
"""Columns of the score over all goals while training, since and before suites had splits."""
