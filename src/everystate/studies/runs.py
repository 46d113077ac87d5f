"""One run of a study: what is to be done, and whether it has been.

The folder of a run gets `evaluation.json` last, which says that it is finished. What trains our
agent leaves `run/`, the run itself, and beside it what tables and figures need of it: `config.json`
and `metrics.jsonl`.
"""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from everystate import evaluation, training
from everystate.agent import config_to_json
from everystate.agent.json_files import read_json
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.evaluation import raw, suites
from everystate.skills import SKILLS
from everystate.training.logging import read_metrics

MEASURED = "evaluation.json"
"""In the folder of every finished run."""


class Task(Protocol):
    """What a run does, once more after a stop: it goes on from what stands in its folder."""

    def __call__(self, folder: Path, typed: Mapping[str, Any]) -> None:
        """Makes the run.

        Args:
            folder: of the run; gets `MEASURED` when all else is done.
            typed: `command` and `argv` of the study, which its results name as their own.
        """
        ...


class Run(NamedTuple):
    """One run of a study. It is pickled on its way to its process."""

    name: str
    """Its place below the study's folder: CONDITION/seedN."""
    task: Task


class Evaluation(NamedTuple):
    """How every agent is measured in the end; see `everystate.evaluation.evaluate`."""

    suite: str | None = None
    split: suites.Split = "report"
    """Of a search `tune`, so that nothing is chosen by what is reported."""
    plan: bool = False
    episodes: int | None = None
    skills: bool = False
    """Where the body has any."""


class Training(NamedTuple):
    """A task: our agent, trained by a config and then measured."""

    config: Config
    evaluation: Evaluation = Evaluation()

    def __call__(self, folder: Path, typed: Mapping[str, Any]) -> None:
        if finished(folder):
            return
        made = training.train(self.config, run_dir=folder / "run", progress=False)
        how = self.evaluation._asdict()
        how["skills"] = how["skills"] and self.config.body in SKILLS
        result = evaluation.evaluate(made, **how)
        result["steps"] = read_metrics(made)[-1]["steps"]
        for name in ("config.json", "metrics.jsonl"):
            shutil.copy(made / name, folder / name)
        raw.write(folder / MEASURED, {**result, **typed})


def finished(folder: Path) -> bool:
    """Whether the run in this folder is trained and measured."""
    return (folder / MEASURED).exists()


def require_same(config: Config, folder: Path) -> None:
    """Complains of a finished run that is of another config than this.

    Raises:
        EverystateError: it is, or what is there is damaged.
    """
    try:
        found = read_json(folder / "config.json")["config"]
    except FileNotFoundError:
        return
    except (OSError, ValueError, KeyError) as error:
        raise EverystateError(f"{folder} is damaged ({error}): move it away") from error
    wanted, unsaid = (_written(config) for config in (config, Config()))
    there = {name: found.get(name, unsaid[name]) for name in wanted}  # older ones lack newer fields
    if not config.interval:
        there["interval"] = 0  # what was measured is there
    differing = [f"{n} {there[n]} there, {x} here" for n, x in wanted.items() if there[n] != x]
    if differing:
        raise EverystateError(
            f"{folder} has another config ({'; '.join(differing)}): choose another --out, or name"
            " the condition otherwise"
        )


def _written(config: Config) -> dict[str, Any]:
    """As a file has it, where tuples are lists."""
    return json.loads(json.dumps(config_to_json(config)))
