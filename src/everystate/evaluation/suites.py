"""Goal suites: fixed goals, start states, horizons and units, so that numbers can be compared.

A suite is one JSON file made by `experiments/make_suites.py`; success is told by the region of the
goal, and in units of `sigma`, the spread of each scored component over a reference set.
"""

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

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
    starts: Float[np.ndarray, "goals state"]
    goals: Float[np.ndarray, "goals state"]
    horizons: Int[np.ndarray, " goals"]
    """Control steps given for each goal."""

    def __post_init__(self) -> None:
        for name in ("sigma", "starts", "goals"):
            if not np.isfinite(getattr(self, name)).all():
                raise EverystateError(f"suite {name} of {self.body} must be finite numbers")
        if not (self.sigma > 0).all() or self.sigma.shape != (len(self.components),):
            raise EverystateError(
                f"suite sigma must be positive, one for each of {self.components}"
            )
        counts = {len(self.starts), len(self.goals), len(self.horizons)}
        if len(counts) != 1 or 0 in counts or self.starts.shape != self.goals.shape:
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
        fields = ("starts", "goals", "horizons")
        return dataclasses.replace(self, **{name: getattr(self, name)[kept] for name in fields})

    def mask(self, names: tuple[str, ...]) -> np.ndarray:
        """Which scored components are named."""
        return np.array([name in names for name in self.components])


def load(body: str, path: Path | str | None = None) -> Suite:
    """The body's own suite, or one from a file."""
    if path is None:
        if body not in SUITES:
            raise EverystateError(
                f"no goal suite for body {body!r} (there are: {', '.join(SUITES)}): give a file of"
                f" goals in the form of {FOLDER.name}/{SUITES[0]}.json"
            )
        path = FOLDER / f"{body}.json"
    try:
        suite = from_json(json.loads(Path(path).read_text()))
    except OSError as error:
        raise EverystateError(f"cannot read goal suite {path}: {error.strerror}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise EverystateError(f"{path} is no goal suite: {error}") from error
    except KeyError as error:
        raise EverystateError(f"{path} is no goal suite: {error} is missing") from error
    if suite.body != body:
        raise EverystateError(f"{path} is a goal suite for {suite.body!r}, not for {body!r}")
    return suite


def from_json(data: dict[str, Any]) -> Suite:
    """Reads what `to_json` returned."""
    if not data["tasks"]:
        raise ValueError("at least 1 task is needed")
    return Suite(
        body=data["body"],
        notes=data.get("notes", ""),
        seed=data.get("seed", 0),
        components=tuple(data["components"]),
        sigma=np.array(data["sigma"], dtype=np.float64),
        angular=tuple(data.get("angular", ())),
        position=tuple(data["position"]),
        starts=np.array([task["start"] for task in data["tasks"]], dtype=np.float64),
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
    tasks = [
        json.dumps({"start": start.tolist(), "goal": goal.tolist(), "horizon": int(horizon)})
        for start, goal, horizon in zip(suite.starts, suite.goals, suite.horizons, strict=True)
    ]
    lines = [f'"{name}": {json.dumps(value)}' for name, value in head.items()]
    return "{\n" + ",\n".join([*lines, '"tasks": [\n' + ",\n".join(tasks)]) + "\n]\n}\n"
