"""Everything that is measured of an agent, in one result."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from everystate.agent import config_to_json, load
from everystate.agent.json_files import read_lines
from everystate.evaluation import suite_file, suites
from everystate.evaluation.agents import Agent
from everystate.evaluation.counting import Counting, OnStep
from everystate.evaluation.measure import measure
from everystate.evaluation.performances import OF_PARTS, STARTS, known_to, success_rates
from everystate.evaluation.perturbations import GRID, summarised
from everystate.evaluation.provenance import provenance
from everystate.evaluation.suite import Suite
from everystate.skills import skills_of


def evaluate(
    agent: Agent | Path | str,
    *,
    suite: Sequence[str | Path] | str | Path | None = None,
    split: suites.Split = "report",
    plan: bool = False,
    episodes: int | None = None,
    skills: bool = False,
    perturb: bool = False,
    seed: int = 0,
    on_step: OnStep | None = None,
) -> dict[str, Any]:
    """Goal reaching on the fixed suites of the agent's body, under the body's own noise.

    Args:
        agent: an agent, or a path to its run, checkpoint or export.
        suite: names of suites of the body, or files of one's own; by default all that it has.
        split: "report", or "tune", to look at while settings are chosen.
        plan: measure planning at act time too; otherwise `planning` is None.
        episodes: only so many tasks of each suite, evenly taken.
        skills: also the named skills of the body; otherwise `skills` is None.
        perturb: also in each world of `perturbations.GRID`; otherwise `perturbed` is None.
        seed: of the body's noise and of planning; the same seed gives the same result.
        on_step: is called after each control step, of all bodies at once, with how many are done,
            how many there are in all, and the share of the work that is done.

    Returns:
        What JSON can hold: `score`, the mean of the policy's over the suites; `suites` by name,
        each with what `measure` returns as `policy` and `planning`, and the suite's split,
        checksum, sigma and number of tasks; `skills` as shares of starts by name, under `policy`
        and `planning`; `perturbed` as in `perturbations.summarised`, of end@0.5 on the first
        suite; `coverage` of the run, if it is one; then config, seed, command, commit, machine and
        versions. None stands where there is no number. Only what is under `time` depends on the
        clock.
    """
    started = time.monotonic()
    run = None
    if isinstance(agent, (str, Path)):
        run, agent = Path(agent), load(agent)
    config = agent.config
    if skills:
        skills_of(config.body)  # a body without any is better told now than after the goals
    if suite is None:
        suite = suites.names(config.body, config.body_options, split)
    wanted = [suite] if isinstance(suite, (str, Path)) else list(suite)
    loaded = [suites.load(config.body, one, config.body_options, split) for one in wanted]
    if episodes is not None:
        loaded = [one.subset(episodes) for one in loaded]
    ways = {"policy": False} | ({"planning": True} if plan else {})
    if on_step:
        each = [int(one.horizons.max()) for one in loaded]
        each += [each[0]] * len(GRID) if perturb else []
        each += [one.steps for one in known_to(agent).values()] if skills else []
        agent = Counting(agent, {False: sum(each), True: sum(each) if plan else 0}, on_step)
    measured = {}
    for one in loaded:
        by = {way: measure(agent, one, plan=plans, seed=seed) for way, plans in ways.items()}
        measured[one.name] = {"planning": None} | by | described(one)
    shown = None
    if skills:
        rates = {way: success_rates(agent, plan=p, seed=seed) for way, p in ways.items()}
        of_parts = None if all(one.whole for one in known_to(agent).values()) else OF_PARTS
        shown = {"planning": None, "starts": STARTS, "starts_of_parts": of_parts} | rates
    return {
        "body": config.body,
        "score": sum(one["policy"]["score"]["all"] for one in measured.values()) / len(measured),
        "suites": measured,
        "skills": shown,
        "perturbed": _perturbed(agent, loaded[0], ways, seed) if perturb else None,
        "coverage": coverage(run),
        "seed": seed,
        "config": config_to_json(config),
        **provenance(),
        "time": {"seconds": round(time.monotonic() - started, 2)},
    }


def coverage(run: Path | None) -> dict[str, float] | None:
    """What the run's last line of metrics says of coverage; None without a run."""
    lines = read_lines(run / "metrics.jsonl") if run is not None else []
    last = lines[-1] if lines else {}
    return {n.removeprefix("coverage/"): x for n, x in last.items() if n[:9] == "coverage/"} or None


def logged(agent: Agent, *, seed: int = 0) -> dict[str, float]:
    """What a run logs of its `tune` suites while it trains, by the policy alone.

    `eval/SUITE/score/GROUP`; and over all tasks of the suite `eval/SUITE/READING@EPS` by the
    largest component, `eval/SUITE/rms_READING@EPS`, and the medians of the closest approach.
    """
    result = evaluate(agent, split="tune", seed=seed)
    found: dict[str, float] = {}
    for name, one in result["suites"].items():
        policy, place = one["policy"], f"eval/{name}"
        found |= {f"{place}/score/{group}": score for group, score in policy["score"].items()}
        for way, groups in policy["success"].items():
            mark = "" if way == "max" else f"{way}_"
            for eps, readings in groups["all"].items():
                found |= {f"{place}/{mark}{r}@{eps}": share for r, share in readings.items()}
        closest = policy["closest"]["all"]
        found |= {f"{place}/closest_{n}": x for n, x in closest.items() if x is not None}
    return found


def described(suite: Suite) -> dict[str, Any]:
    """What a result says of a suite it was measured on."""
    return {
        "tasks": len(suite.goals),
        "split": suite.split,
        "scored_by": "{}, {}@0.5".format(*suite.scored_by),
        "notes": suite.notes,
        "made_from_seed": suite.seed,
        "checksum": suite_file.checksum(suite_file.as_json(suite)),
        "sigma": dict(zip(suite.components, suite.sigma.tolist(), strict=True)),
    }


def _perturbed(agent: Agent, suite: Suite, ways: Mapping[str, bool], seed: int) -> dict[str, Any]:
    """What becomes of success in other worlds, by the policy and, if wanted, with planning."""

    def success(*, plan: bool) -> list[float]:
        worlds = (measure(agent, suite, plan=plan, seed=seed, world=w) for w in GRID)
        return [world["success"]["max"]["all"]["0.5"]["end"] for world in worlds]

    return {"planning": None} | {way: summarised(success(plan=p)) for way, p in ways.items()}
