"""Sends an agent to every goal of a suite, all at once, and measures how that went."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.table import Table

from everystate.agent import config_to_json, load, step_seed
from everystate.agent.files import read_lines
from everystate.envs import BodyVectorEnv, make, parse_options
from everystate.evaluation import metrics, suites
from everystate.evaluation.agents import Agent
from everystate.evaluation.performances import STARTS, success_rates
from everystate.evaluation.perturbations import GRID, summarised
from everystate.evaluation.provenance import provenance
from everystate.skills import skills_of


def evaluate(
    agent: Agent | Path | str,
    *,
    plan: bool = True,
    goals_file: Path | str | None = None,
    episodes: int | None = None,
    skills: bool = False,
    perturb: bool = False,
    seed: int = 0,
) -> dict[str, Any]:
    """Goal reaching on the fixed suite of the agent's body, under the body's own noise.

    Args:
        agent: an agent, or a path to its run, checkpoint or export.
        plan: measure planning at act time too; otherwise `success_plan` is None.
        goals_file: a goal suite of one's own instead of the body's.
        episodes: only so many goals, evenly taken from the suite.
        skills: also the named skills of the body; otherwise `skills` and `skills_plan` are None.
        perturb: also in each world of `perturbations.GRID`; otherwise `perturbed` is None.
        seed: of the body's noise and of planning; the same seed gives the same result.

    Returns:
        What JSON can hold: `success`, `success_plan` and `position_only` by region, eps, reading;
        `skills` and `skills_plan` as shares of 20 starts by name; `perturbed` as in
        `perturbations.summarised`;
        `falls_per_1000_steps`; `calibration` of -V against measured steps; `coverage` of the run,
        if it is one; then config, seed, command, commit, machine and versions. None stands where
        there is no number. Only what is under `time` depends on the clock.
    """
    started = time.monotonic()
    run = None
    if isinstance(agent, (str, Path)):
        run, agent = Path(agent), load(agent)
    if skills:
        skills_of(agent.config.body)  # a body without any is better told now than after the goals
    suite = suites.load(agent.config.body, goals_file, agent.config.body_options)
    if episodes is not None:
        suite = suite.subset(episodes)
    with_policy = _measure(agent, suite, plan=False, seed=seed)
    planning = _measure(agent, suite, plan=True, seed=seed) if plan else None
    return {
        "body": suite.body,
        "goals": len(suite.goals),
        "success": with_policy["success"],
        "success_plan": planning and planning["success"],
        "position_only": with_policy["position_only"],
        "skills": success_rates(agent, plan=False, seed=seed) if skills else None,
        "skills_plan": success_rates(agent, plan=True, seed=seed) if skills and plan else None,
        "perturbed": _perturbed(agent, suite, plan=plan, seed=seed) if perturb else None,
        "falls_per_1000_steps": with_policy["falls_per_1000_steps"],
        "falls_by_region": with_policy["falls_by_region"],
        "calibration": with_policy["calibration"],
        "coverage": coverage(run),
        "plan": planning and {k: v for k, v in planning.items() if k.startswith("falls")},
        "seed": seed,
        "suite": {
            "file": None if goals_file is None else Path(goals_file).name,
            "notes": suite.notes,
            "seed": suite.seed,
            "sigma": dict(zip(suite.components, suite.sigma.tolist(), strict=True)),
        },
        "config": config_to_json(agent.config),
        **provenance(),
        "time": {"seconds": round(time.monotonic() - started, 2)},
    }


def rollout(
    agent: Agent,
    env: BodyVectorEnv,
    starts: Float[np.ndarray, "envs state"] | None,
    goals: Float[np.ndarray, "envs state"],
    steps: int,
    *,
    plan: bool,
    seed: int,
) -> Float[np.ndarray, "_ envs state"]:
    """States [steps + 1, envs, state] of bodies sent from starts to goals; no episode rule.

    Without starts each body sets out from where a reset puts it.
    """
    if starts is None:
        observations, _ = env.reset(seed=seed)
    else:
        env.set_observations(starts)
        observations = np.asarray(starts, dtype=np.float32)
    goals = np.asarray(goals, dtype=np.float32)
    states = [observations]
    for step in range(steps):
        actions = agent.act(observations, goals, plan=plan, seed=step_seed(seed, step))
        observations, _, _, _, info = env.step(actions)
        states.append(info.get("final_obs", observations))
    return np.stack(states)


def coverage(run: Path | None) -> dict[str, float] | None:
    """What the run's last line of metrics says of coverage; None without a run."""
    lines = read_lines(run / "metrics.jsonl") if run is not None else []
    last = lines[-1] if lines else {}
    return {n.removeprefix("coverage/"): x for n, x in last.items() if n[:9] == "coverage/"} or None


def table(result: Mapping[str, Any]) -> Table:
    """The result as it is printed: one row per region, at most 80 columns wide."""
    shown = Table(title=f"Goal reaching, {result['body']}, {result['goals']} goals")
    shown.add_column("goals on")
    for eps in metrics.EPS:
        shown.add_column(f"last step\n@{eps:g}", justify="right")
    shown.add_column("any step\n@0.5", justify="right")
    if result["success_plan"]:
        shown.add_column("planning\nlast @0.5", justify="right")
    for name, row in result["success"].items():
        if name == "all":
            shown.add_section()
        cells = [row[f"{eps:g}"]["last"] for eps in metrics.EPS] + [row["0.5"]["any"]]
        if result["success_plan"]:
            cells.append(result["success_plan"][name]["0.5"]["last"])
        shown.add_row(name, *(f"{100 * cell:.1f} %" for cell in cells))
    steps_off = result["calibration"]["mae"]
    shown.caption = f"{result['falls_per_1000_steps']:.1f} falls per 1,000 steps" + (
        "" if steps_off is None else f"; -V is off by {steps_off:.1f} steps on average"
    )
    return shown


def skills_table(result: Mapping[str, Any]) -> Table:
    """The shares of starts from which the named skills succeeded."""
    shown = Table(title="Named skills", caption=f"of {STARTS} starts")
    shown.add_column("skill")
    for heading in ("policy", "planning"):
        shown.add_column(heading, justify="right")
    planned = result["skills_plan"] or {}
    for name, rate in result["skills"].items():
        cells = [rate, *([planned[name]] if planned else [])]
        shown.add_row(name, *(f"{100 * cell:.0f} %" for cell in cells))
    return shown


def perturbed_table(result: Mapping[str, Any]) -> Table:
    """Success over all goals in the worlds of the perturbation grid."""
    shown = Table(title=f"Other masses, motors and noise, {len(GRID)} worlds")
    shown.add_column("success@0.5, last step")
    names = {"nominal": "as trained", "mean": "mean", "cvar10": "worst tenth", "worst": "worst"}
    for heading in names.values():
        shown.add_column(heading, justify="right")
    for how, found in result["perturbed"].items():
        if found:
            shown.add_row(how, *(f"{100 * found[name]:.1f} %" for name in names))
    return shown


def _perturbed(agent: Agent, suite: suites.Suite, *, plan: bool, seed: int) -> dict[str, Any]:
    """What becomes of success in other worlds, by the policy and, if wanted, with planning."""

    def success(*, plan: bool) -> list[float]:
        worlds = (_measure(agent, suite, plan=plan, seed=seed, world=w) for w in GRID)
        return [world["success"]["all"]["0.5"]["last"] for world in worlds]

    return {
        "policy": summarised(success(plan=False)),
        "planning": summarised(success(plan=True)) if plan else None,
    }


def _measure(
    agent: Agent,
    suite: suites.Suite,
    *,
    plan: bool,
    seed: int,
    world: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    options = parse_options(agent.config.body_options) | dict(world or {})
    env = make(suite.body, len(suite.goals), seed, **options)
    starts, goals, horizons = suite.starts, suite.goals, suite.horizons
    states = rollout(agent, env, starts, goals, int(horizons.max()), plan=plan, seed=seed)
    regions = env.regions(goals)
    scored, scored_goals = env.scored(states[1:]), env.scored(goals)
    angular = suite.mask(suite.angular)
    distance = metrics.distances(scored, scored_goals, suite.sigma, angular)
    at = suite.mask(suite.position)
    place = metrics.distances(scored[..., at], scored_goals[..., at], suite.sigma[at], angular[at])
    falls = env.falls(states[:-1], states[1:])
    predicted = np.asarray(agent.steps_to_goal(states[0], goals.astype(np.float32)))
    groups = {name: regions == name for name in dict.fromkeys(regions.tolist())}
    return {
        "success": metrics.success(distance, horizons, regions),
        "position_only": metrics.success(place, horizons, regions),
        "falls_per_1000_steps": metrics.rate(falls, horizons),
        "falls_by_region": {
            name: metrics.rate(falls[:, chosen], horizons[chosen])
            for name, chosen in groups.items()
        },
        "calibration": metrics.calibration(
            predicted, metrics.first_steps(distance, horizons, metrics.EPS[0])
        ),
    }
