"""What a sweep consists of, read from its TOML file.

    bodies = ["ramp-pointmass"]  # one or more
    preset = "quick"
    seeds = 3                    # seeds 0, 1, 2; or a list of them

    [options]                    # of `everystate train`, for all runs; names as in `Config`
    epochs = 60

    [evaluation]                 # of `everystate evaluate`
    plan = false

    [settings.as-it-is]          # one table of further options for each setting; none is one
    [settings.no-curriculum]     # without any
    p_curric = 0.0

Instead of settings and seeds, a search has

    [search]
    trials = 20
    metric = "score"  # a path into evaluation.json; the greater the better

    [search.space]
    learning_rate = {low = 1e-4, high = 1e-2, log = true}
    j = {low = 1, high = 4}
    relative_goals = {choices = [true, false]}
"""

import hashlib
import itertools
import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple

from everystate.config import Config
from everystate.errors import EverystateError, suggest
from everystate.evaluation import suites
from everystate.presets import preset

PERIOD = 20
"""Epochs between evaluations during training, where `evaluation_period` is not given."""


class Evaluation(NamedTuple):
    """How every agent is measured in the end; see `everystate.evaluation.evaluate`."""

    suite: str | None = None
    split: suites.Split = "report"
    """Of a search `tune`, so that nothing is chosen by what is reported."""
    plan: bool = False
    episodes: int | None = None
    skills: bool = False


class Trial(NamedTuple):
    """One run of a sweep."""

    name: str
    """Its place below the sweep's folder: SETTING/seedN, or of a search trial-DIGEST."""
    config: Config
    evaluation: Evaluation


class Range(NamedTuple):
    """Where a search looks for a number."""

    low: float
    high: float
    log: bool = False


Space = Mapping[str, Range | tuple[Any, ...]]
"""By option of training: a range, or choices."""


class Search(NamedTuple):
    """What is searched, and how it is scored."""

    trials: int
    metric: str
    space: Space

    def score(self, result: Mapping[str, Any]) -> float:
        """The number that the metric is a path to in an evaluation."""
        found: Any = result
        for name in self.metric.split("/"):
            found = found.get(name) if isinstance(found, Mapping) else None
        if not isinstance(found, (int, float)):
            raise EverystateError(f"metric = {self.metric!r} is no number in evaluation.json")
        return float(found)


@dataclass(frozen=True)
class Sweep:
    """Seeds x bodies x settings, or a search."""

    bodies: tuple[str, ...]
    preset: str = "quick"
    seeds: tuple[int, ...] = (0,)
    options: Mapping[str, Any] = field(default_factory=dict)
    evaluation: Evaluation = field(default_factory=Evaluation)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    search: Search | None = None

    def trials(self) -> list[Trial]:
        """All runs, seed by seed, so that a sweep that is stopped has first seeds of everything."""
        settings = self.settings or {"all": {}}
        return [
            Trial(f"{name}/seed{seed}", self._config(body, seed, options), self.evaluation)
            for seed, body in itertools.product(self.seeds, self.bodies)
            for name, options in zip(self.groups(body), settings.values(), strict=True)
        ]

    def groups(self, body: str) -> list[str]:
        """Names of the settings of one body: with others beside it, they begin with its own."""
        names = list(self.settings) or ["all"]
        return names if len(self.bodies) == 1 else [f"{Path(body).stem}-{name}" for name in names]

    def found(self, values: Mapping[str, Any]) -> Trial:
        """The run of a search with these values."""
        digest = hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:8]
        config = self._config(self.bodies[0], self.seeds[0], values)
        return Trial(f"trial-{digest}", config, self.evaluation)

    def _config(self, body: str, seed: int, options: Mapping[str, Any]) -> Config:
        given = {"evaluation_period": PERIOD, **self.options, **options}
        lists = {name: tuple(x) if isinstance(x, list) else x for name, x in given.items()}
        return preset(self.preset, body, seed=seed, **lists)


def read(path: Path) -> Sweep:
    """The sweep in a file; every config that it names is made once, to see that it can be.

    Raises:
        EverystateError: it cannot be read, or something in it is unknown or out of range.
    """
    try:
        given = tomllib.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise EverystateError(f"{path} cannot be read as a sweep: {error}") from error
    try:
        sweep = _sweep(given)
        if sweep.search is None:
            sweep.trials()
        else:
            for values in _corners(sweep.search.space):
                sweep.found(values)
    except EverystateError as error:
        raise EverystateError(f"{path}: {error}") from error
    return sweep


def _sweep(given: Mapping[str, Any]) -> Sweep:
    _require_known(given, {f.name for f in fields(Sweep)}, "")
    bodies, seeds = given.get("bodies", []), given.get("seeds", 1)
    counted = isinstance(seeds, int) and not isinstance(seeds, bool)
    listed: Any = list(range(seeds)) if counted else seeds
    if not bodies or not _is_list_of(bodies, str) or len(set(bodies)) < len(bodies):
        raise EverystateError('bodies: list one or more, as in bodies = ["cartpole"]')
    if not listed or not _is_list_of(listed, int) or len(set(listed)) < len(listed):
        raise EverystateError(f"seeds = {seeds}: give how many, or a list of them")
    settings = _table(given, "settings")
    for name in settings:
        _table(settings, name)
        if Path(name).name != name or name.startswith("."):
            raise EverystateError(f"settings.{name}: choose a name that a folder can have")
    search = _search(_table(given, "search")) if "search" in given else None
    if search and (settings or len(listed) > 1 or len(bodies) > 1):
        raise EverystateError("search: takes one body, one seed and no settings")
    evaluation = _table(given, "evaluation")
    _require_known(evaluation, Evaluation._fields, "evaluation.")
    if search:
        evaluation = {"split": "tune", **evaluation}
    return Sweep(
        tuple(bodies),
        given.get("preset", "quick"),
        tuple(listed),
        _table(given, "options"),
        Evaluation(**evaluation),
        settings,
        search,
    )


def _search(given: Mapping[str, Any]) -> Search:
    _require_known(given, Search._fields, "search.")
    trials, metric = given.get("trials"), given.get("metric", "score")
    if not isinstance(trials, int) or trials < 1:
        raise EverystateError(f"search.trials = {trials}: give how many, 1 or more")
    space: dict[str, Range | tuple[Any, ...]] = {}
    for name, wanted in _table(given, "space").items():
        try:
            space[name] = tuple(wanted["choices"]) if "choices" in wanted else Range(**wanted)
            assert len(space[name]) > 0
            assert "choices" in wanted or wanted["low"] < wanted["high"]
        except (TypeError, AssertionError) as error:
            raise EverystateError(
                f"search.space.{name} = {wanted}: give low and high (and log = true), or choices"
            ) from error
    if not space:
        raise EverystateError("search.space: name at least one option to search")
    return Search(trials, str(metric), space)


def _corners(space: Space) -> list[dict[str, Any]]:
    """Values that show whether all are possible: the ends of every range, and every choice."""
    ends = {name: x[:2] if isinstance(x, Range) else x for name, x in space.items()}
    first = {name: values[0] for name, values in ends.items()}
    return [first | {name: value} for name, values in ends.items() for value in values]


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
