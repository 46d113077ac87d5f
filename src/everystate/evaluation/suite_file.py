"""Suites as JSON, one line for each task, with a checksum of what they say."""

import hashlib
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from everystate import envs
from everystate.envs import Physics
from everystate.evaluation.suite import Suite


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
