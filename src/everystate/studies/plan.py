"""What a study consists of, read from its TOML file.

body = "ramp-pointmass"
preset = "quick"
seeds = 3                    # seeds 0, 1, 2; or a list of them

[options]                    # of `everystate train`, for all runs; names as in `Config`
epochs = 60

[evaluation]                 # of `everystate evaluate`
plan = false

[readings]                   # if any: columns of metrics.jsonl, told for every seed
names = ["eval/rest/score/all"]
epochs = [40, 60]            # the last one, if none are named

[conditions.as-it-is]        # a table of further options for each condition; none is one
[conditions.no-curriculum]   # without any
p_curric = 0.0
seeds = 5                    # a condition may have a body, preset and seeds of its own
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple

from everystate.config import Config
from everystate.errors import EverystateError, suggest
from everystate.presets import preset
from everystate.studies.runs import Evaluation, Run, Training

PERIOD = 20
"""Epochs between evaluations during training, where `evaluation_period` is not given."""


class Condition(NamedTuple):
    """What is the same for several seeds."""

    body: str
    preset: str
    seeds: tuple[int, ...]
    options: Mapping[str, Any]
    """Fields of the config."""

    def config(self, seed: int) -> Config:
        """That of one seed."""
        lists = {n: tuple(x) if isinstance(x, list) else x for n, x in self.options.items()}
        return preset(self.preset, self.body, seed=seed, **{"evaluation_period": PERIOD, **lists})


class Readings(NamedTuple):
    """Columns of metrics.jsonl that are told for every seed, and after which epochs."""

    names: tuple[str, ...]
    epochs: tuple[int, ...] = ()


@dataclass(frozen=True)
class Study:
    """Conditions x seeds."""

    conditions: Mapping[str, Condition]
    evaluation: Evaluation = field(default_factory=Evaluation)
    readings: Readings | None = None

    def runs(self) -> list[Run]:
        """All, seed by seed, so that a study that is stopped has first seeds of everything."""
        seeds = dict.fromkeys(seed for one in self.conditions.values() for seed in one.seeds)
        return [
            Run(f"{name}/seed{seed}", Training(one.config(seed), self.evaluation))
            for seed in sorted(seeds)
            for name, one in self.conditions.items()
            if seed in one.seeds
        ]


def read(path: Path) -> Study:
    """The study in a file; every config that it names is made once, to see that it can be.

    Raises:
        EverystateError: it cannot be read, or something in it is unknown or out of range.
    """
    try:
        given = tomllib.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise EverystateError(f"{path} cannot be read as a study: {error}") from error
    try:
        study = _study(given)
        for one in study.conditions.values():
            _require_read(study.readings, [one.config(seed) for seed in one.seeds])
    except EverystateError as error:
        raise EverystateError(f"{path}: {error}") from error
    return study


_KNOWN = {"body", "preset", "seeds", "options", *(f.name for f in fields(Study))}


def _study(given: Mapping[str, Any]) -> Study:
    _require_known(given, _KNOWN, "")
    options, tables = _table(given, "options"), _table(given, "conditions")
    shared = {n: given[n] for n in ("body", "preset", "seeds") if n in given}
    shared = {"preset": "quick", "seeds": 1, **options, **shared}
    named = {name: _table(tables, name) for name in tables} or {"all": {}}
    conditions = {name: _condition(name, {**shared, **own}) for name, own in named.items()}
    readings = _readings(_table(given, "readings")) if "readings" in given else None
    evaluation = _table(given, "evaluation")
    _require_known(evaluation, Evaluation._fields, "evaluation.")
    return Study(conditions, Evaluation(**evaluation), readings)


def _condition(name: str, given: Mapping[str, Any]) -> Condition:
    if Path(name).name != name or name.startswith("."):
        raise EverystateError(f"conditions.{name}: choose a name that a folder can have")
    body, seeds = given.get("body"), given["seeds"]
    if not isinstance(body, str):
        raise EverystateError('body: name one, as in body = "cartpole"')
    counted = isinstance(seeds, int) and not isinstance(seeds, bool)
    listed: Any = list(range(seeds)) if counted else seeds
    if not listed or not _is_list_of(listed, int) or len(set(listed)) < len(listed):
        raise EverystateError(f"seeds = {seeds}: give how many, or a list of them")
    options = {n: x for n, x in given.items() if n not in ("body", "preset", "seeds")}
    return Condition(body, given["preset"], tuple(listed), options)


def _readings(given: Mapping[str, Any]) -> Readings:
    _require_known(given, Readings._fields, "readings.")
    names, epochs = given.get("names", []), given.get("epochs", [])
    if not names or not _is_list_of(names, str):
        raise EverystateError('readings.names: list some, as in names = ["eval/rest/score/all"]')
    if not _is_list_of(epochs, int):
        raise EverystateError(f"readings.epochs = {epochs}: list numbers, as in epochs = [40, 60]")
    return Readings(tuple(names), tuple(epochs))


def _require_read(readings: Readings | None, configs: Sequence[Config]) -> None:
    """That there will be something to read after these epochs."""
    if readings is None:
        return
    for config in configs:
        looked = any(name.startswith("eval/") for name in readings.names)
        period = (config.evaluation_period or config.epochs + 1) if looked else 1
        for epoch in readings.epochs or (config.epochs,):
            if not 1 <= epoch <= config.epochs or epoch % period:
                raise EverystateError(
                    f"readings after epoch {epoch} of {config.epochs}: there are some every"
                    f" {period} epochs; choose such readings.epochs, or another evaluation_period"
                )


def _table(given: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = given.get(name, {})
    if not isinstance(found, Mapping):
        raise EverystateError(f"{name} = {found!r}: make it a table, [{name}]")
    return found


def _require_known(given: Mapping[str, Any], known: Sequence[str] | set[str], above: str) -> None:
    for name in given:
        if name not in known:
            raise EverystateError(f"unknown {above}{name}: {suggest(name, known)}")


def _is_list_of(found: object, kind: type) -> bool:
    return isinstance(found, list) and all(type(item) is kind for item in found)
