"""Curves of a run's training, for its report."""

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from everystate.training.logging import read_metrics
from everystate.viewing import plots
from everystate.viewing.figures import scores
from everystate.viewing.pictures import Picture

_CURVES = 4
"""So many in a panel can be told apart."""


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
            "Scores on the suites that are for looking at while settings are chosen (tune): of all"
            " goals, and where there are many kinds of the first and the last.",
            [(f"suite {suite}", _few(labels)) for suite, labels in evaluated.items()],
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


def _few(labels: Mapping[str, str]) -> dict[str, str]:
    """As many curves as one can tell apart."""
    names = list(labels)
    kinds = [name for name in names if labels[name] != "all"]
    kept = names if len(names) <= _CURVES else [kinds[0], kinds[-1], *set(names) - set(kinds)]
    return {name: labels[name] for name in kept}
