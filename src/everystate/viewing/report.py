"""The report of a run: one page that needs nothing else, and the same pictures as PNG files."""

import base64
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from everystate.agent import load
from everystate.envs import BodyVectorEnv, make, parse_options
from everystate.errors import EverystateError
from everystate.evaluation import references, suites
from everystate.evaluation.suite import Suite
from everystate.training.collection import read_samples
from everystate.viewing import maps, page, plots
from everystate.viewing.curves import over_time
from everystate.viewing.film import journey
from everystate.viewing.pictures import Film, Picture


def report(
    run_dir: Path | str,
    result: Mapping[str, Any],
    *,
    agent: maps.Explorer | None = None,
    out: Path | None = None,
) -> Path:
    """Writes `index.html`, its PNGs and the result, and returns the page's path.

    Random actions and doing nothing are measured on the same goals, to compare with. A picture that
    cannot be drawn is replaced by a line that says why; its own pictures of before are replaced,
    other files in the folder are left as they are. What planning does is drawn where the result has
    it.

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
    result = {**result, "references": references(result, agent.config)}
    shown: list[page.Shown] = []
    for picture in pictures(run_dir, result, agent):
        path = folder / picture.file
        path.unlink(missing_ok=True)  # an older one would be taken for this run's
        try:
            picture.write(path)
            data = base64.b64encode(path.read_bytes()).decode()
            source = f"data:image/{path.suffix[1:]};base64,{data}"
            shown.append(page.Shown(picture.title, picture.caption, source))
        except EverystateError as error:
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


def pictures(
    run_dir: Path, result: Mapping[str, Any], agent: maps.Explorer
) -> list[Picture | Film]:
    """All pictures there are for this run, in the order of the page."""
    config = agent.config
    env = make(config.body, 1, 0, **parse_options(config.body_options))
    suite = suites.load(config.body, options=config.body_options)
    first = next(iter(result["suites"].values()))
    if first["tasks"] < len(suite.goals):
        suite = suite.subset(first["tasks"])
    planning = bool(first["planning"])
    film = Film(
        "On its way",
        "From a start to a goal (green ghost) of the suite, under the body's own noise, and a"
        " second at it: a task of median duration among those it holds. Below are the steps to go"
        " by −V, and the largest distance of a component from the goal.",
        lambda: journey(agent, env, suite, planning=planning),
        env,
    )
    reached = [
        _reached(name, one, result["references"].get(name, {}))
        for name, one in result["suites"].items()
    ]
    mapped = on_the_map(run_dir, agent, env, suite, planning=planning)
    return [film, *reached, *mapped, *over_time(run_dir)]


def _reached(name: str, suite: Mapping[str, Any], references: Mapping[str, Any]) -> Picture:
    measure, reading = page.scored_by(suite)
    column = f"{measure}_{'nearest' if reading == 'hit' else reading}"
    ways = {way: suite[way] for way in ("policy", "planning") if suite[way]} | dict(references)
    distances = {way: one["tasks"][column] for way, one in ways.items()}
    return Picture(
        f"reached-{name}",
        f"How near it comes, suite {name}",
        f"Share of {suite['tasks']} goals by the tolerance at which they count; σ is the spread of"
        " each component over the body's world. Random actions and doing nothing stand beside it.",
        lambda: plots.reached(distances, page.NEAR[measure], page.VERBS[reading][1]),
    )


def on_the_map(
    run_dir: Path,
    agent: maps.Explorer,
    env: BodyVectorEnv,
    suite: Suite,
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


def middle_goals(env: BodyVectorEnv, suite: Suite) -> dict[str, Float[np.ndarray, " state"]]:
    """Of each region the suite's goal nearest to the middle of all."""
    regions = env.regions(suite.goals)
    found = {}
    for name in dict.fromkeys(regions.tolist()):
        goals = suite.goals[regions == name]
        found[name] = goals[((goals - goals.mean(axis=0)) ** 2).sum(axis=1).argmin()]
    return found
