"""Agents side by side: the same body, harness and wall-clock, each on one core."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from everystate.agent.json_files import read_json
from everystate.errors import EverystateError
from everystate.evaluation import raw, suites
from everystate.evaluation.provenance import provenance
from everystate.presets import preset
from everystate.studies import agents as known
from everystate.studies import pool, summary
from everystate.studies.runs import MEASURED, Run, finished
from everystate.studies.timed import RESCORED, Rescoring, Terms, Timed

_MOST = 100_000


def compare(
    terms: Terms, agents: Sequence[str], seeds: int, folder: Path, *, workers: int | None = None
) -> dict[str, Any]:
    """Trains and measures every agent with every seed, all of one seed in one block of the pool.

    Doing nothing and random actions are part of it, named or not. What is in the folder already is
    not done again, so the same command goes on after a stop.

    Args:
        terms: what is the same for all.
        agents: names from `agents.AGENTS`.
        seeds: how many, from 0.
        folder: gets `AGENT/seedN`, `comparison.json` with everything over seeds, its main numbers
            as `comparison.md`, and their growth as `comparison-minutes.png` and `-steps.png`.
        workers: how many runs are made at a time, by default as many as there are cores.

    Raises:
        EverystateError: a term is out of range, an agent is unknown or not installed, the folder
            is of another comparison, a block was begun on another machine, or runs failed; those
            that did not are kept, and in the tables.
    """
    agents = known.complete(agents)
    if not (1 <= seeds <= _MOST and 0 < terms.minutes <= _MOST):
        raise EverystateError(
            f"{seeds} seeds of {terms.minutes:g} minutes: choose from 1 to {_MOST:,} seeds, and"
            f" more than 0 and up to {_MOST:,} minutes"
        )
    preset(terms.preset, terms.body)
    suite = suites.load(terms.body)
    suite.subset(len(suite.goals) if terms.episodes is None else terms.episodes)
    _claim(folder, terms)
    blocks = [_block(folder, terms, agents, seed) for seed in range(seeds)]
    for seed, block in enumerate(blocks):
        if block:
            _claim_block(folder, seed)
    problems = pool.run_all(blocks, folder, workers=workers)
    result = write(folder, agents)
    pool.complain(problems)
    return result


def rescore(body: str, folder: Path, *, workers: int | None = None) -> dict[str, Any]:
    """Measures every agent of a comparison again from what was kept of it; nothing is trained.

    Args:
        body: of the comparison.
        folder: of the comparison; gets `AGENT/seedN/rescored.json`, and over seeds
            `comparison-rescored.json` and `.md`. What was measured before stays as it is.
        workers: as in `compare`.

    Raises:
        EverystateError: there is no comparison of this body, or something kept is missing or not
            what was measured.
    """
    try:
        found = read_json(folder / "terms.json")
        terms = Terms(**{name: found[name] for name in Terms._fields})
    except (OSError, ValueError, KeyError) as error:
        raise EverystateError(f"{folder} holds no comparison: give its folder as --out") from error
    if terms.body != body:
        raise EverystateError(f"{folder} compares agents on {terms.body}, not on {body}")
    blocks: dict[int, list[Run]] = {}
    for name, runs in summary.folders(folder, _present(folder)).items():
        for seed in map(summary.seed_of, runs):
            task = Rescoring(Timed(name, seed, terms))
            blocks.setdefault(seed, []).append(Run(f"{name}/seed{seed}", task))
    pool.complain(pool.run_all(list(blocks.values()), folder, workers=workers))
    return write(folder, [], RESCORED)


def write(folder: Path, agents: Iterable[str], measured: str = MEASURED) -> dict[str, Any]:
    """Everything over seeds, as files, from the results in the folder alone.

    Of all agents there are results of, and of those named even where there are none. Scores are
    told after as many steps as the slowest run took too. Looks while training were scored as the
    runs were at first: of runs that are measured again nothing is told after equal steps.
    """
    named = [*dict.fromkeys([*agents, *_present(folder)])]
    named = sorted(named, key=lambda name: name in known.ALWAYS)  # these come last
    groups = summary.folders(folder, named, measured)
    steps = [read_json(run / measured)["steps"] for runs in groups.values() for run in runs]
    result = read_json(folder / "terms.json")
    if measured == MEASURED:
        fewest = min(filter(None, steps), default=0)
        conditions = summary.gather(groups, equal_steps=fewest)
        result |= {"equal_steps": fewest, "conditions": conditions}
        for over in ("minutes", "steps"):
            summary.draw(groups, folder / f"comparison-{over}.png", over=over)
    else:
        result["conditions"] = summary.gather(groups, measured)
    name = "comparison" if measured == MEASURED else "comparison-rescored"
    summary.write_numbers(folder, result, name=name)
    return result


def _block(folder: Path, terms: Terms, agents: Sequence[str], seed: int) -> list[Run]:
    """What is to be done of a seed."""
    runs = [Run(f"{name}/seed{seed}", Timed(name, seed, terms)) for name in agents]
    return [run for run in runs if not finished(folder / run.name)]


def _present(folder: Path) -> list[str]:
    return [name for name in known.AGENTS if any((folder / name).glob(f"seed*/{MEASURED}"))]


def _claim(folder: Path, terms: Terms) -> None:
    """The folder for a comparison on these terms."""
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


def _claim_block(folder: Path, seed: int) -> None:
    """A block for this machine: no agent of a seed is to have the faster one."""
    path, machine = folder / "blocks" / f"seed{seed}.json", provenance()["machine"]
    if not path.exists():
        raw.write(path, {"seed": seed, "machine": machine})
    elif (begun := read_json(path)["machine"]) != machine:
        raise EverystateError(
            f"the block of seed {seed} was begun on another machine ({begun} there, {machine}"
            f" here): go on there, or delete {path} and every seed{seed} in {folder}"
        )
