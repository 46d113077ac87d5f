"""Goal suites: fixed tasks, each from a start to a goal, so that numbers can be compared.

A suite is one JSON file, made by a script of `tools/`. Each task has the physics of its
start, its goal as it is observed, a horizon, and what kind it is. Success is in units of `sigma`,
the spread of each scored component over a reference set that never changes. A body has a suite for
each question (`rest`: states it can stay in; `motion`: states that it can only pass), each in two
splits of different seeds: `tune`, to look at while settings are chosen, and `report`.
"""

import dataclasses
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from everystate import envs
from everystate.agent.json_files import read_json
from everystate.envs import BodyVectorEnv, Physics
from everystate.errors import EverystateError, suggest
from everystate.evaluation import metrics

FOLDER = Path(__file__).with_name("suites")
Split = Literal["tune", "report"]


@dataclass(frozen=True, eq=False)
class Suite:
    """What an evaluation asks of a body. Arrays are in the body's own units."""

    body: str
    name: str
    split: str
    notes: str
    seed: int
    """Seed from which the suite was made; the evaluation has its own."""
    components: tuple[str, ...]
    """Names of what `Body.scored` returns."""
    sigma: Float[np.ndarray, " scored"]
    angular: tuple[str, ...]
    """Components that are angles in radians: their differences are wrapped."""
    position: tuple[str, ...]
    """Components that position-only success looks at."""
    velocity: tuple[str, ...]
    """Components that are velocities; the closest approach is told of them and of all others."""
    starts: tuple[Physics, ...] | None
    """As `BodyVectorEnv.get_physics` has it; None for a body that can only be reset."""
    goals: Float[np.ndarray, "tasks state"]
    """Observations."""
    weights: Float[np.ndarray, "tasks scored"]
    """How much each component counts: 1, or 0 for one that is not asked for."""
    kinds: tuple[str, ...]
    """Of each task."""
    k: Int[np.ndarray, " tasks"]
    """Steps from start to goal on the recorded path that the task was cut from; 0 without one."""
    horizons: Int[np.ndarray, " tasks"]
    """Control steps given for each goal."""
    actions: tuple[Float[np.ndarray, "_ action"], ...] | None = None
    """Those that led from each start to its goal, for a suite cut from paths."""

    def __post_init__(self) -> None:
        what = f"suite {self.name!r} of {self.body}"
        for name, values in (("sigma", self.sigma), ("goals", self.goals), ("k", self.k)):
            if not np.isfinite(values).all():
                raise EverystateError(f"{what}: {name} must be finite numbers")
        if not (self.sigma > 0).all() or self.sigma.shape != (len(self.components),):
            raise EverystateError(
                f"{what}: sigma must be positive, one for each of {self.components}"
            )
        counts = {len(self.goals), len(self.horizons), len(self.kinds), len(self.k)}
        counts |= {len(x) for x in (self.starts, self.actions) if x is not None}
        if len(counts) != 1 or 0 in counts:
            raise EverystateError(
                f"{what}: starts, goals, kinds, k and horizons must be equally many, at least 1"
            )
        if self.horizons.min() < 1:
            raise EverystateError(
                f"{what}: horizon is {self.horizons.min()}: at least 1 step is needed"
            )
        if self.weights.shape != (len(self.goals), len(self.components)) or not (
            np.isfinite(self.weights).all() and (self.weights >= 0).all()
        ):
            raise EverystateError(f"{what}: weights must be 0 or more, one for each component")
        if not (self.weights > 0).any(axis=1).all():
            raise EverystateError(f"{what}: each task needs a component of a weight above 0")
        for name in (*self.angular, *self.position, *self.velocity):
            if name not in self.components:
                raise EverystateError(
                    f"{what} has no component {name!r}: {suggest(name, self.components)}"
                )

    @property
    def groups(self) -> dict[str, Bool[np.ndarray, " tasks"]]:
        """Which tasks are of which kind, of which k, and all."""
        kinds = np.array(self.kinds)
        found = {kind: kinds == kind for kind in dict.fromkeys(self.kinds)}
        found |= {f"k={k}": self.k == k for k in np.unique(self.k) if k > 0}
        return found | {"all": np.ones(len(kinds), dtype=bool)}

    @property
    def scored_by(self) -> tuple[str, str]:
        """Measure and reading, within 0.5 sigma, that make its one score.

        Of what can only be passed that is a hit, and of all else the end.
        """
        if self.name not in ("motion", "parts-motion"):
            return "max", "end"
        return metrics.chief(int((self.weights > 0).sum(axis=1).max())), "hit"

    def asked(self, state_names: Sequence[str]) -> Float32[np.ndarray, "tasks state"]:
        """The goals, NaN in each component of the state that is not asked for."""
        goals = self.goals.astype(np.float32)
        for i, name in enumerate(self.components):
            if name in state_names:
                goals[self.weights[:, i] == 0, state_names.index(name)] = np.nan
        return goals

    def subset(self, count: int) -> "Suite":
        """About evenly spaced tasks of the suite, which keeps the share of every kind."""
        if not 1 <= count <= len(self.goals):
            raise EverystateError(f"episodes is {count}: choose 1 to {len(self.goals)}")
        return self.only(np.linspace(0, len(self.goals) - 1, count).round().astype(int))

    def only(self, chosen: Int[np.ndarray, " n"]) -> "Suite":
        """These tasks of the suite."""

        def of(values: tuple | None) -> tuple | None:
            return None if values is None else tuple(values[i] for i in chosen)

        arrays = {n: getattr(self, n)[chosen] for n in ("goals", "weights", "k", "horizons")}
        lists = {n: of(getattr(self, n)) for n in ("starts", "kinds", "actions")}
        return dataclasses.replace(self, **arrays, **lists)

    def mask(self, names: tuple[str, ...]) -> Bool[np.ndarray, " scored"]:
        """Which scored components are named."""
        return np.array([name in names for name in self.components])

    def begin(self, env: BodyVectorEnv, seed: int) -> Float[np.ndarray, "tasks state"]:
        """Puts a body for each task to its start, or resets it; returns what they observe."""
        if self.starts is None:
            return env.reset(seed=seed)[0]
        env.set_physics(self.starts)
        return env.observe()


def names(body: str, options: Sequence[str] = ()) -> tuple[str, ...]:
    """The suites of whole states of a body: those in the package, or one made on the spot."""
    return tuple(name for name in every(body, options) if not name.startswith("parts"))


def every(body: str, options: Sequence[str] = ()) -> tuple[str, ...]:
    """Its suites, those too that ask for parts of states."""
    files = (FOLDER / body).glob("*-report.json")
    found = tuple(sorted(path.stem.removesuffix("-report") for path in files))
    if not found or (options and _state(body, options) != _state(body)):
        return ("visited",)
    return tuple(sorted(found, key=lambda name: name != "rest"))


def load(
    body: str,
    suite: Path | str | None = None,
    options: Sequence[str] = (),
    split: Split = "report",
) -> Suite:
    """A suite of the body by its name, or from a file; by default the first that it has.

    Raises:
        EverystateError: no such suite, or a file that is none, damaged, or of another body.
    """
    known = every(body, options)
    suite = known[0] if suite is None else suite
    if suite == "visited":
        from everystate.evaluation.visited import on_the_spot

        return on_the_spot(body, tuple(options), split)
    shipped = suite in known
    path = FOLDER / body / f"{suite}-{split}.json" if shipped else Path(suite)
    if not shipped and path.suffix != ".json":
        raise EverystateError(
            f"{body} has no suite {str(suite)!r}: {suggest(str(suite), known)}, or the path of a"
            " file ending in .json"
        )
    try:
        found = from_json(read_json(path), options)
    except OSError as error:
        raise EverystateError(f"cannot read goal suite {path}: {error.strerror}") from error
    except (ValueError, TypeError, AttributeError, OverflowError) as error:
        raise EverystateError(f"{path} is no goal suite: {error}") from error
    except KeyError as error:
        raise EverystateError(f"{path} is no goal suite: {error} is missing") from error
    if found.body != body:
        raise EverystateError(f"{path} is a goal suite for {found.body!r}, not for {body!r}")
    return found


def _state(body: str, options: Sequence[str] = ()) -> Sequence[str]:
    return envs.make(body, 1, 0, **envs.parse_options(options)).state_names


def from_json(data: dict[str, Any], options: Sequence[str] = ()) -> Suite:
    """Reads what `to_json` returned, or what a person wrote, who may leave out what has a default.

    A start may be the physics or, for a body that can be placed, what is observed.
    """
    tasks, components = data["tasks"], tuple(data["components"])
    if not tasks:
        raise ValueError("at least 1 task is needed")
    if "checksum" in data and data["checksum"] != checksum(data):
        raise ValueError("its checksum is not that of its content: it was changed or damaged")
    ones = [1.0] * len(components)
    actions = [task.get("actions") for task in tasks]
    return Suite(
        body=data["body"],
        name=data.get("name", "own"),
        split=data.get("split", ""),
        notes=data.get("notes", ""),
        seed=data.get("seed", 0),
        components=components,
        sigma=np.array(data["sigma"], dtype=np.float64),
        angular=tuple(data.get("angular", ())),
        position=tuple(data["position"]),
        velocity=tuple(data.get("velocity", ())),
        starts=_starts(data["body"], [task["start"] for task in tasks], options),
        goals=np.array([task["goal"] for task in tasks], dtype=np.float64),
        weights=np.array([task.get("weights", ones) for task in tasks], dtype=np.float64),
        kinds=tuple(str(task.get("kind", "all")) for task in tasks),
        k=np.array([task.get("k", 0) for task in tasks], dtype=np.int64),
        horizons=np.array([task["horizon"] for task in tasks], dtype=np.int64),
        actions=None if None in actions else tuple(np.array(a, dtype=np.float64) for a in actions),
    )


def _starts(body: str, starts: list[Any], options: Sequence[str]) -> tuple[Physics, ...] | None:
    if None in starts:
        return None
    if all(isinstance(start, dict) for start in starts):
        return tuple(starts)
    env = envs.make(body, len(starts), 0, **envs.parse_options(options))
    env.set_observations(np.array(starts, dtype=np.float64))
    return tuple(env.get_physics())


def as_json(suite: Suite) -> dict[str, Any]:
    """What a suite's file holds, without its checksum."""
    head: dict[str, Any] = {
        "body": suite.body,
        "name": suite.name,
        "split": suite.split,
        "notes": suite.notes,
        "seed": suite.seed,
        "components": list(suite.components),
        "sigma": suite.sigma.tolist(),
        "angular": list(suite.angular),
        "position": list(suite.position),
        "velocity": list(suite.velocity),
    }
    tasks = []
    for i, goal in enumerate(suite.goals.tolist()):
        task: dict[str, Any] = {"kind": suite.kinds[i]}
        task |= {"k": int(suite.k[i])} if suite.k[i] else {}
        task |= {"horizon": int(suite.horizons[i])}
        task |= {"start": None if suite.starts is None else suite.starts[i], "goal": goal}
        if (suite.weights[i] != 1).any():
            task["weights"] = suite.weights[i].tolist()
        if suite.actions is not None:
            task["actions"] = suite.actions[i].tolist()
        tasks.append(task)
    return head | {"tasks": tasks}


def to_json(suite: Suite) -> str:
    """The file of a suite: one line per task, to be read and compared by people."""
    data = as_json(suite)
    tasks = ",\n".join(json.dumps(task) for task in data.pop("tasks"))
    data["checksum"] = checksum(as_json(suite))
    lines = [f'"{name}": {json.dumps(value)}' for name, value in data.items()]
    return "{\n" + ",\n".join([*lines, f'"tasks": [\n{tasks}']) + "\n]\n}\n"


def checksum(data: dict[str, Any]) -> str:
    """SHA-256 of a suite's JSON, as canonical text and without its own checksum."""
    rest = {name: value for name, value in data.items() if name != "checksum"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
