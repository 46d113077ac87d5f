"""Several settings and seeds of one body: trained and measured on Ray, their raw results kept.

Wants `make scale`. `results/NAME/SETTING/seedN` gets what everystate/scaling/trial.py says; a run
that was stopped goes on when the command is given again, and what is finished is left as it is,
also where its config would be another today. Medians and intervals over seeds are in
`results/NAME/summary.json`. NAME is the body's, unless an experiment has one of its own.
"""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from everystate import scaling
from everystate.evaluation import raw
from everystate.evaluation.aggregate import over_seeds
from everystate.presets import preset
from everystate.scaling import Evaluation, Trial

RESULTS = Path(__file__).resolve().parent.parent / "results"
PERIOD = 20
"""Epochs between evaluations during training."""


class Setting(NamedTuple):
    """What is trained, how often, and how it is measured."""

    options: Mapping[str, Any]
    """Fields of the config."""
    seeds: int
    evaluation: Evaluation = Evaluation()
    preset: str = "quick"


Settings = Mapping[str, Setting]


def results_of(name: str) -> Path:
    """Where the raw results of a body or an experiment are kept."""
    return RESULTS / Path(name).stem


def trial(body: str, name: str, setting: Setting, seed: int) -> Trial:
    """One run of a setting."""
    options = {"evaluation_period": PERIOD, **setting.options}
    config = preset(setting.preset, body, seed=seed, **options)
    return Trial(f"{name}/seed{seed}", config, setting.evaluation)


def summarise(where: str, settings: Settings) -> dict[str, list[Path]]:
    """Writes summary.json; returns the folders of the finished runs there are, by setting."""
    results = results_of(where)
    folders = {
        name: [run.parent for run in sorted((results / name).glob("seed*/evaluation.json"))]
        for name in settings
    }
    folders = {name: found for name, found in folders.items() if found}
    summaries = {name: over_seeds(evaluations(found)) for name, found in folders.items()}
    raw.write(results / "summary.json", summaries, replace=True)
    return folders


def evaluations(folders: Sequence[Path]) -> list[dict[str, Any]]:
    """What was measured of these runs."""
    return [json.loads((folder / "evaluation.json").read_text()) for folder in folders]


def main(
    body: str,
    settings: Settings,
    draw: Callable[[dict[str, list[Path]]], None],
    *,
    description: str,
    name: str | None = None,
) -> None:
    """Every setting and seed asked for, one per core at a time; then the summary and figures."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--settings", nargs="+", default=list(settings), choices=settings)
    parser.add_argument("--seeds", nargs="+", type=int, help="instead of all of each setting")
    parser.add_argument("--summary-only", action="store_true")
    options = parser.parse_args()
    where = name or body
    if not options.summary_only:
        wanted = [
            trial(body, name, settings[name], seed)
            for name in options.settings
            for seed in options.seeds or range(settings[name].seeds)
        ]
        scaling.run_all(wanted, results_of(where))
    draw(summarise(where, settings))
