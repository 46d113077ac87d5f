"""What a recording of anybody's agent comes to, in the words of an evaluation."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from everystate.benchmark.recording import read
from everystate.envs import make
from everystate.evaluation import described, provenance
from everystate.evaluation.measure import score_states
from everystate.evaluation.references import beside


@dataclass(frozen=True)
class _Body:
    """All that those who learned nothing are told."""

    body: str
    body_options: tuple[str, ...] = ()


def score(path: Path | str, suite: str | Path | None = None) -> dict[str, Any]:
    """Scores the states of a recording as `everystate.evaluation.evaluate` scores an agent's.

    Args:
        path: a file that `record` or `save` wrote.
        suite: file of the suite, if it is of one's own.

    Returns:
        What JSON can hold, as `evaluate` returns it of a policy on one suite; there is no config
        and no calibration, as no agent is there to ask. `suites[NAME]["references"]` has what
        becomes of the same tasks under random actions and doing nothing.

    Raises:
        EverystateError: the file is no recording, or one of another suite or with other starts.
    """
    tasks, states = read(path, suite)
    unknown = np.full(len(tasks.goals), np.nan)
    policy = score_states(make(tasks.body, 1, 0), tasks, states, unknown)
    shown = {"policy": policy, "planning": None} | described(tasks)
    shown["references"] = beside(tasks, _Body(tasks.body))
    return {
        "body": tasks.body,
        "score": policy["score"]["all"],
        "suites": {tasks.name: shown},
        "skills": None,
        "perturbed": None,
        "recording": Path(path).name,
        **provenance(),
    }
