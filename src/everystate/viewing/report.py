"""The report of a run: one page that needs nothing else, and the same pictures as PNG files."""

import base64
import functools
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from everystate.agent import load
from everystate.envs import BodyVectorEnv, make, parse_options
from everystate.errors import EverystateError
from everystate.evaluation import suites
from everystate.training.collection import read_samples
from everystate.training.logging import read_metrics
from everystate.viewing import maps, page, plots
from everystate.viewing.figures import scores
from everystate.viewing.film import filmstrip


class Picture(NamedTuple):
    """A figure of the report."""

    name: str
    """Its file is NAME.png."""
    title: str
    caption: str
    draw: Callable[[], Figure]


def report(
    run_dir: Path | str,
    result: Mapping[str, Any],
    *,
    agent: maps.Explorer | None = None,
    out: Path | None = None,
) -> Path:
    """Writes `index.html`, its PNGs and the result, and returns the page's path.

    A picture that cannot be drawn is replaced by a line that says why; other files in the folder
    are left as they are. What planning does is drawn where the result has it.

    Args:
        run_dir: a run's folder, with its metrics, samples and checkpoints; or an agent, as `load`
            takes it.
        result: what `everystate.evaluation.evaluate` returned.
        agent: the run's agent, where it has been loaded already.
        out: see `report_folder`.

    Raises:
        EverystateError: no agent there, or no folder to write to.
    """
    folder, run_dir = report_folder(run_dir, out), Path(run_dir)
    agent = load(run_dir) if agent is None else agent
    shown: list[page.Shown] = []
    for picture in pictures(run_dir, result, agent):
        path = folder / f"{picture.name}.png"
        try:
            plots.save(picture.draw(), path)
            data = base64.b64encode(path.read_bytes()).decode()
            shown.append(page.Shown(picture.title, picture.caption, data))
        except EverystateError as error:
            path.unlink(missing_ok=True)  # an older one would be taken for this run's
            shown.append(page.Shown(picture.title, f"Not drawn: {error}", None))
    (folder / "evaluation.json").write_text(json.dumps(result, allow_nan=False) + "\n")
    target = folder / "index.html"
    target.write_text(page.page(run_dir.resolve().name, result, shown), encoding="utf-8")
    return target


def report_folder(run_dir: Path | str, out: Path | None = None) -> Path:
    """The folder that a report goes to, made if need be: `out`, by default RUN/report.

    Raises:
        EverystateError: without `out`, it is no run; or the folder cannot be made.
    """
    run_dir = Path(run_dir)
    if out is None and (not run_dir.is_dir() or (run_dir / "agent.json").exists()):
        raise EverystateError(
            f"{run_dir} is an agent without its run: name a folder for its report with --out"
        )
    folder = run_dir / "report" if out is None else out
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise EverystateError(
            f"cannot write to {folder} ({error.strerror}): name another folder with --out"
        ) from error
    return folder


def pictures(run_dir: Path, result: Mapping[str, Any], agent: maps.Explorer) -> list[Picture]:
    """All pictures there are for this run, in the order of the page."""
    config = agent.config
    env = make(config.body, 1, 0, **parse_options(config.body_options))
    suite = suites.load(config.body, options=config.body_options)
    first = next(iter(result["suites"].values()))
    if first["tasks"] < len(suite.goals):
        suite = suite.subset(first["tasks"])
    planning = bool(first["planning"])
    found = [
        *_successes(result),
        Picture(
            "filmstrip",
            "On its way",
            "From a start to a goal (green ghost) of the suite, under the body's own noise, until"
            " the body is within 0.5 σ of it: a task of median duration among those it holds.",
            lambda: filmstrip(agent, env, suite, planning=planning),
        ),
    ]
    mapped = on_the_map(run_dir, agent, env, suite, planning=planning)
    return found + mapped + over_time(run_dir)


def _successes(result: Mapping[str, Any]) -> list[Picture]:
    return [
        Picture(
            f"success-{name}",
            f"Goals reached, suite {name}",
            f"Share of {suite['tasks']} fixed tasks ({suite['scored_by']}). σ is the spread of"
            " each component over the body's world.",
            functools.partial(plots.success_by_group, suite),
        )
        for name, suite in result["suites"].items()
    ]


def over_time(run_dir: Path) -> list[Picture]:
    """Curves of the training, from metrics.jsonl."""
    columns = plots.columns(read_metrics(run_dir))
    if "steps" not in columns:
        return []
    if "episode/ended" in columns:  # an epoch in which none ended says nothing of episodes
        for name in ("episode/length", "episode/reached"):
            columns[name] = np.where(columns["episode/ended"] > 0, columns[name], np.nan)
    if not columns.get("env/falls_per_1000", np.zeros(1)).any():  # a body that cannot fall
        columns.pop("env/falls_per_1000", None)
    models = {"f": "states", "d": "dynamics", "pi": "policy", "c": "curriculum", "V": "value"}
    curves: dict[str, tuple[str, str, list[tuple[str, dict[str, str]]], dict[str, Any]]] = {
        "coverage": (
            "Exploration",
            "Share of the cells of a fixed grid over the body's bounds that were ever visited, and"
            " falls while training.",
            [
                ("cells visited", {"coverage/cells": ""}),
                ("falls per 1,000 steps", {"env/falls_per_1000": ""}),
            ],
            {"share": [0]},
        ),
        "episodes": (
            "Episodes",
            "Episodes end when V has stopped rising; a goal counts as reached when the body came"
            " near it at any step. Goals are the least likely of those the agent imagined: as it"
            " learns it sets itself harder ones.",
            [
                ("steps per episode", {"episode/length": ""}),
                ("training goals reached", {"episode/reached": ""}),
            ],
            {"share": [1]},
        ),
        "replay": (
            "Effective sample sizes",
            "How many items of each buffer a draw is spread over, (Σw)²/Σw². Near 1 the learner"
            " would see the same item again and again.",
            [
                (
                    "effective number of items",
                    {
                        "replay/ess_states": "states",
                        "replay/ess_goals": "goals",
                        "replay/ess_transitions": "transitions",
                        "replay/size": "buffer size",
                    },
                )
            ],
            {"log": True, "columns": 1},
        ),
        "targets": (
            "Value targets",
            "About minus the number of steps to the goal: the targets of V, and the least of each"
            " minibatch, as means over an epoch.",
            [("V target", {"value/target": "mean", "value/target_min": "least"})],
            {"columns": 1},
        ),
        "losses": (
            "Losses",
            "Negative log-likelihoods of the four flows (nats) and the squared error of V.",
            [(f"{n}: {what}", {f"loss/{n}": ""}) for n, what in models.items()],
            {"columns": 3},
        ),
    }
    evaluated = scores(columns)
    if evaluated:
        curves["evaluation"] = (
            "Goals reached while training",
            "Scores on the suites that are for looking at while settings are chosen (tune).",
            [(f"suite {suite}", labels) for suite, labels in evaluated.items()],
            {"share": list(range(len(evaluated))), "columns": 1},
        )
    found = []
    for name, (title, caption, panels, options) in curves.items():
        kept = [i for i, (_, panel) in enumerate(panels) if not columns.keys().isdisjoint(panel)]
        shares = [i for i, panel in enumerate(kept) if panel in options.get("share", ())]
        drawn, options = [panels[i] for i in kept], options | {"share": shares}
        draw = functools.partial(plots.over_time, columns, drawn, **options)
        found += [Picture(name, title, caption, draw)] if drawn else []
    return found


def on_the_map(
    run_dir: Path,
    agent: maps.Explorer,
    env: BodyVectorEnv,
    suite: suites.Suite,
    *,
    planning: bool = False,
) -> list[Picture]:
    """Pictures of the state space, for bodies whose state is a place on a map."""
    if not maps.drawable(env):
        return []
    goals = middle_goals(env, suite)
    last = list(goals)[-1]
    found = [
        Picture(
            "values",
            "How far it thinks it is",
            "Steps to the goal (star), −V(s, g), from every state. Solid lines are cliffs, dotted"
            " ones the foot and the top of the ramp.",
            lambda: maps.value_maps(agent, env, goals),
        ),
    ]
    if env.single_action_space.shape == (2,):  # or an action is no arrow on the map
        arrows = Picture(
            "policy",
            "What it does",
            f"Actions on the way to one goal on the {last} (star): the policy at z = 0"
            + (", and the first of the best few that a short search finds." if planning else "."),
            lambda: maps.policy_arrows(
                agent, env, goals[last], planning=planning, batch=len(suite.goals)
            ),
        )
        found.append(arrows)
    samples = sorted((run_dir / "samples").glob("*.npz"))
    if samples:

        def drawn() -> Figure:
            found = read_samples(samples[-1])
            return maps.goal_cloud(agent, env, found["next_observations"], found["goals"])

        cloud = Picture(
            "goals",
            "What it wants to try",
            f"Left: states visited in epoch {int(samples[-1].stem)} and the goals of that time."
            " Right: goals the agent proposes to itself now, each the least likely of those it"
            " imagined. The grey frame is where the body can be.",
            drawn,
        )
        found.append(cloud)
    return found


def middle_goals(env: BodyVectorEnv, suite: suites.Suite) -> dict[str, Float[np.ndarray, " state"]]:
    """Of each region the suite's goal nearest to the middle of all."""
    regions = env.regions(suite.goals)
    found = {}
    for name in dict.fromkeys(regions.tolist()):
        goals = suite.goals[regions == name]
        found[name] = goals[((goals - goals.mean(axis=0)) ** 2).sum(axis=1).argmin()]
    return found
