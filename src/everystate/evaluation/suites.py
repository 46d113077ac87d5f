"""Goal suites: fixed goals, start states, horizons and units, so that numbers can be compared.

A suite is one JSON file made by `experiments/make_suites.py`; success is told by the region of the
goal, and in units of `sigma`, the spread of each scored component over a reference set.
"""

import dataclasses
import functools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from everystate import envs
from everystate.agent.files import read_json
from everystate.errors import EverystateError, suggest

FOLDER = Path(__file__).with_name("suites")
SUITES: tuple[str, ...] = tuple(sorted(path.stem for path in FOLDER.glob("*.json")))


@dataclass(frozen=True, eq=False)
class Suite:
    """What an evaluation asks of a body. Arrays are in the body's own units."""

    body: str
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
    starts: Float[np.ndarray, "goals state"] | None
    """None for a body that can only be reset: then it starts wherever that puts it."""
    goals: Float[np.ndarray, "goals state"]
    horizons: Int[np.ndarray, " goals"]
    """Control steps given for each goal."""

    def __post_init__(self) -> None:
        starts = self.goals if self.starts is None else self.starts
        for name, values in (("sigma", self.sigma), ("starts", starts), ("goals", self.goals)):
            if not np.isfinite(values).all():
                raise EverystateError(f"suite {name} of {self.body} must be finite numbers")
        if not (self.sigma > 0).all() or self.sigma.shape != (len(self.components),):
            raise EverystateError(
                f"suite sigma must be positive, one for each of {self.components}"
            )
        counts = {len(starts), len(self.goals), len(self.horizons)}
        if len(counts) != 1 or 0 in counts or starts.shape != self.goals.shape:
            raise EverystateError(
                "suite starts, goals and horizons must be equally many, at least 1"
            )
        if self.horizons.min() < 1:
            raise EverystateError(
                f"suite horizon is {self.horizons.min()}: at least 1 step is needed"
            )
        for name in (*self.angular, *self.position):
            if name not in self.components:
                raise EverystateError(
                    f"suite has no component {name!r}: {suggest(name, self.components)}"
                )

    def subset(self, count: int) -> "Suite":
        """About evenly spaced goals of the suite, which keeps the share of every region."""
        if not 1 <= count <= len(self.goals):
            raise EverystateError(f"episodes is {count}: choose 1 to {len(self.goals)}")
        kept = np.linspace(0, len(self.goals) - 1, count).round().astype(int)
        return dataclasses.replace(
            self,
            starts=None if self.starts is None else self.starts[kept],
            goals=self.goals[kept],
            horizons=self.horizons[kept],
        )

    def mask(self, names: tuple[str, ...]) -> np.ndarray:
        """Which scored components are named."""
        return np.array([name in names for name in self.components])


def load(body: str, path: Path | str | None = None, options: Sequence[str] = ()) -> Suite:
    """The body's own suite, or one from a file; for a body without either, one made on the spot.

    So is that of a body whose options give it another state.
    """
    if path is None:
        if body not in SUITES or (options and _state(body, options) != _state(body)):
            return on_the_spot(body, tuple(options))
        path = FOLDER / f"{body}.json"
    try:
        suite = from_json(read_json(Path(path)))
    except OSError as error:
        raise EverystateError(f"cannot read goal suite {path}: {error.strerror}") from error
    except (ValueError, TypeError, AttributeError, OverflowError) as error:
        raise EverystateError(f"{path} is no goal suite: {error}") from error
    except KeyError as error:
        raise EverystateError(f"{path} is no goal suite: {error} is missing") from error
    if suite.body != body:
        raise EverystateError(f"{path} is a goal suite for {suite.body!r}, not for {body!r}")
    return suite


def _state(body: str, options: Sequence[str] = ()) -> Sequence[str]:
    return envs.make(body, 1, 0, **envs.parse_options(options)).state_names


@functools.lru_cache(maxsize=4)
def on_the_spot(body: str, options: tuple[str, ...] = (), seed: int = 0) -> Suite:
    """A suite for any body: states that random actions led to, spread as evenly as they allow.

    A body does not get everywhere by chance, so this asks for less than a suite made by hand.
    """
    env = envs.make(body, 20, seed, **envs.parse_options(options))
    played = envs.random_play(env, 400, seed).reshape(-1, len(env.state_names))
    sigma = env.scored(played).std(axis=0)
    chosen = spread_out(played / np.where(played.std(axis=0) > 1e-6, played.std(axis=0), 1), 200)
    rng = np.random.default_rng(seed)
    names = env.state_names
    if sigma.shape != (len(names),):
        raise EverystateError(f"{body} needs a goal suite of its own: give a file of goals")
    return Suite(
        body=body,
        notes="Made on the spot from states reached by random actions.",
        seed=seed,
        components=names,
        sigma=np.where(sigma > 1e-6, sigma, 1.0),
        angular=(),
        position=names,
        starts=played[rng.choice(len(played), len(chosen))] if env.placeable else None,
        goals=played[chosen],
        horizons=np.full(len(chosen), 200),
    )


def spread_out(points: Float[np.ndarray, "n dims"], count: int) -> Int[np.ndarray, " count"]:
    """Indices of points far from one another: each the farthest from all before it."""
    chosen = [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmin())]
    nearest = np.full(len(points), np.inf)
    for _ in range(min(count, len(points)) - 1):
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(nearest.argmax()))
    return np.array(chosen)


def from_json(data: dict[str, Any]) -> Suite:
    """Reads what `to_json` returned."""
    if not data["tasks"]:
        raise ValueError("at least 1 task is needed")
    starts = [task["start"] for task in data["tasks"]]
    return Suite(
        body=data["body"],
        notes=data.get("notes", ""),
        seed=data.get("seed", 0),
        components=tuple(data["components"]),
        sigma=np.array(data["sigma"], dtype=np.float64),
        angular=tuple(data.get("angular", ())),
        position=tuple(data["position"]),
        starts=None if None in starts else np.array(starts, dtype=np.float64),
        goals=np.array([task["goal"] for task in data["tasks"]], dtype=np.float64),
        horizons=np.array([task["horizon"] for task in data["tasks"]], dtype=np.int64),
    )


def to_json(suite: Suite) -> str:
    """One line per task, to be read and compared by people."""
    head = {
        "body": suite.body,
        "notes": suite.notes,
        "seed": suite.seed,
        "components": suite.components,
        "sigma": suite.sigma.tolist(),
        "angular": suite.angular,
        "position": suite.position,
    }
    starts = [None] * len(suite.goals) if suite.starts is None else suite.starts.tolist()
    tasks = [
        json.dumps({"start": start, "goal": goal.tolist(), "horizon": int(horizon)})
        for start, goal, horizon in zip(starts, suite.goals, suite.horizons, strict=True)
    ]
    lines = [f'"{name}": {json.dumps(value)}' for name, value in head.items()]
    return "{\n" + ",\n".join([*lines, '"tasks": [\n' + ",\n".join(tasks)]) + "\n]\n}\n"
