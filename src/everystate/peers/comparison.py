"""Agents side by side: the same body, harness and wall-clock, each on one core."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from everystate.agent.files import read_json
from everystate.errors import EverystateError
from everystate.evaluation import raw, suites
from everystate.evaluation.aggregate import over_seeds, summary
from everystate.peers import blocks, contestants, reading
from everystate.peers.contest import MEASURED, RESCORED, Terms
from everystate.peers.tables import table
from everystate.presets import preset
from everystate.training.logging import read_metrics
from everystate.training.rundir import write_atomically

_MOST = 100_000


def compare(terms: Terms, agents: Sequence[str], seeds: int, folder: Path) -> dict[str, Any]:
    """Trains and measures every agent with every seed, block by block (`blocks.py`).

    Doing nothing and random actions are part of it, named or not. What is in the folder already is
    not done again, so the same command goes on after a stop.

    Args:
        terms: what is the same for all.
        agents: names from `contestants.CONTESTANTS`.
        seeds: how many, from 0.
        folder: gets `AGENT/seedN`, `comparison.json` with everything over seeds, its main numbers
            as `comparison.md`, and their growth as `comparison-minutes.png` and `-steps.png`.

    Raises:
        EverystateError: a term is out of range, an agent is unknown or not installed, the folder
            is of another comparison, a block was begun on another machine, or runs failed; those
            that did not are kept, and in the tables.
    """
    agents = contestants.complete(agents)
    if not (1 <= seeds <= _MOST and 0 < terms.minutes <= _MOST):
        raise EverystateError(
            f"{seeds} seeds of {terms.minutes:g} minutes: choose from 1 to {_MOST:,} seeds, and"
            f" more than 0 and up to {_MOST:,} minutes"
        )
    preset(terms.preset, terms.body)
    suite = suites.load(terms.body)
    suite.subset(len(suite.goals) if terms.episodes is None else terms.episodes)
    _claim(folder, terms)
    problems = blocks.run(folder, agents, range(seeds), "play")
    result = write(folder, agents)
    _complain(problems)
    return result


def rescore(body: str, folder: Path) -> dict[str, Any]:
    """Measures every agent of a comparison again from what was kept of it; nothing is trained.

    Args:
        body: of the comparison.
        folder: of the comparison; gets `AGENT/seedN/rescored.json`, and over seeds
            `comparison-rescored.json` and `.md`. What was measured before stays as it is.

    Raises:
        EverystateError: there is no comparison of this body, or something kept is missing or not
            what was measured.
    """
    try:
        found = read_json(folder / "terms.json")["body"]
    except (OSError, ValueError, KeyError) as error:
        raise EverystateError(f"{folder} holds no comparison: give its folder as --out") from error
    if found != body:
        raise EverystateError(f"{folder} compares agents on {found}, not on {body}")
    seeds = sorted({int(run.name.removeprefix("seed")) for run in folder.glob("*/seed[0-9]*/")})
    _complain(blocks.run(folder, _present(folder), seeds, "replay"))
    return write(folder, [], RESCORED)


def write(folder: Path, agents: Sequence[str], measured: str = MEASURED) -> dict[str, Any]:
    """Everything over seeds, as files, from the results in the folder alone.

    Of all agents there are results of, and of those named even where there are none.
    """
    from everystate.viewing.figures import comparison

    named = [*dict.fromkeys([*agents, *_present(folder)])]
    named = sorted(named, key=lambda name: name in contestants.ALWAYS)  # these come last
    groups = {name: sorted((folder / name).glob("seed*"), key=_seed) for name in named}
    groups = {name: [r for r in runs if (r / measured).exists()] for name, runs in groups.items()}
    result = gather(read_json(folder / "terms.json"), groups, measured)
    end = "" if measured == MEASURED else "-rescored"
    raw.write(folder / f"comparison{end}.json", result, replace=True)
    write_atomically(folder / f"comparison{end}.md", table(result))
    grown = {n: [r for r in found if read_metrics(r)] for n, found in groups.items()}
    grown = {n: found for n, found in grown.items() if found}
    for over in ("minutes", "steps") if grown and not end else ():
        comparison(grown, over=over).savefig(folder / f"comparison-{over}.png", dpi=150)
    return result


def gather(
    terms: Mapping[str, Any], groups: Mapping[str, Sequence[Path]], measured: str = MEASURED
) -> dict[str, Any]:
    """Evaluations over seeds by agent, and success after as many steps as the slowest took.

    An agent without runs has `seeds` of none and nothing else. Looks while training were scored as
    the runs were at first: of runs that are measured again nothing is told after equal steps.
    """
    read = {name: [read_json(run / measured) for run in g] for name, g in groups.items()}
    taken = [one["steps"] for found in read.values() for one in found if one["steps"]]
    fewest = min(taken, default=0)
    agents: dict[str, Any] = {}
    for name, found in read.items():
        if not found:
            agents[name] = {"seeds": []}
            continue
        looks = [_success_by(run, fewest) for run in groups[name]] if measured == MEASURED else []
        agents[name] = over_seeds(found) | {
            "steps": summary([float(one["steps"]) for one in found]),
            "at_equal_steps": _summaries(looks),
        }
    return {**terms, "equal_steps": fewest, "agents": agents}


def _present(folder: Path) -> list[str]:
    return [n for n in contestants.CONTESTANTS if any((folder / n).glob(f"seed*/{MEASURED}"))]


def _seed(run: Path) -> int:
    return int(run.name.removeprefix("seed"))


def _complain(problems: Sequence[str]) -> None:
    if problems:
        raise EverystateError(
            f"{len(problems)} runs failed; the same command tries them again."
            f" The first: {problems[0]}"
        )


def _success_by(run: Path, steps: int) -> dict[str, float]:
    """Success@0.5 by region at the last look before so many steps; empty without any."""
    found: dict[str, float] = {}
    for line in read_metrics(run):
        if line["steps"] <= steps:
            found = reading.looked(line) or found
    return found


def _summaries(found: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    regions = dict.fromkeys(region for one in found for region in one)
    return {r: summary([one[r] for one in found if r in one]) for r in regions}


def _claim(folder: Path, terms: Terms) -> None:
    path, wanted = folder / "terms.json", json.loads(json.dumps(terms._asdict()))
    if path.exists():
        found = read_json(path)
        differing = [
            f"{n} {found.get(n)} there, {x} here" for n, x in wanted.items() if found.get(n) != x
        ]
        if differing:
            raise EverystateError(
                f"{folder} holds another comparison ({'; '.join(differing)}): choose another --out"
            )
        return
    if folder.exists() and any(folder.iterdir()):
        raise EverystateError(f"{folder} is not empty and no comparison: choose another --out")
    folder.mkdir(parents=True, exist_ok=True)
    raw.write(path, wanted)
