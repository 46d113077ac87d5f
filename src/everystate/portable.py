"""An agent's policy without JAX: a list of steps on arrays, which NumPy runs.

    policy = everystate.portable.load("policy.npz")  # from agent.export("policy.npz")
    action = policy.act(observation, goal)

Of this package it needs `everystate.errors` alone, and besides NumPy only jaxtyping.
"""

import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np
from jaxtyping import Float32
from numpy.typing import ArrayLike

from everystate.errors import EverystateError

FORMAT = 1
"""Of the files that `load` reads."""
INPUTS = "observation", "goal"
OUTPUT = "action"
DESCRIPTION = "policy"
"""The array of a file that is no constant but says, as JSON, what to do with them."""

# By their names in ONNX, where they mean the same; arrays are [batch, n].
OPERATORS: Mapping[str, Callable[..., np.ndarray]] = {
    "Add": np.add,
    "And": np.logical_and,
    "Or": np.logical_or,
    "Concat": lambda *parts: np.concatenate(parts, axis=1),
    "Cos": np.cos,
    "Div": np.divide,
    "Exp": np.exp,
    "GreaterOrEqual": np.greater_equal,
    "MatMul": np.matmul,
    "Max": np.maximum,
    "Min": np.minimum,
    "Mul": np.multiply,
    "PRelu": lambda x, slope: np.where(x >= 0, x, slope * x),
    "Sin": np.sin,
    "Sqrt": np.sqrt,
    "Sub": np.subtract,
    "Where": np.where,
}
_PROBLEMS = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)
"""What reading a damaged file may raise."""


class Step(NamedTuple):
    """One operator: what it takes, and the name of what it makes."""

    operator: str
    inputs: tuple[str, ...]
    output: str


@final
class Policy(NamedTuple):
    """What an agent does by its policy alone: `agent.act`, but for rounding."""

    state_names: tuple[str, ...]
    """Of the components of states and goals, in order."""
    action_names: tuple[str, ...]
    """Of the components of actions, in order."""
    steps: tuple[Step, ...]
    """From `INPUTS` to `OUTPUT`, one after the other."""
    constants: Mapping[str, np.ndarray]
    """The arrays that steps name besides."""

    def act(self, observation: ArrayLike, goal: ArrayLike) -> Float32[np.ndarray, "*n action"]:
        """The action, in [-1, 1], that leads from each state towards its goal.

        Either is a state `[state]` or a batch `[n, state]`, in the units of the body. What is not
        finite is not looked for.

        Raises:
            EverystateError: a state of another shape.
        """
        given = [np.asarray(x, dtype=np.float32) for x in (observation, goal)]
        for name, x in zip(INPUTS, given, strict=True):
            if x.ndim not in (1, 2) or x.shape[-1] != len(self.state_names):
                raise EverystateError(
                    f"the {name} has shape {x.shape}: expected ({len(self.state_names)},) or"
                    f" (n, {len(self.state_names)}), for {', '.join(self.state_names)}"
                )
        batches = np.broadcast_arrays(*(np.atleast_2d(x) for x in given))
        known = dict(self.constants) | dict(zip(INPUTS, batches, strict=True))
        for operator, inputs, output in self.steps:
            known[output] = OPERATORS[operator](*(known[name] for name in inputs))
        single = all(x.ndim == 1 for x in given)
        return known[OUTPUT][0] if single else known[OUTPUT]


def load(path: str | Path) -> Policy:
    """The policy in a file that `agent.export("NAME.npz")` wrote; runs no code of the file.

    Raises:
        EverystateError: there is none, a damaged one, or one of another version.
    """
    try:
        with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        told: dict[str, Any] = json.loads(str(arrays.pop(DESCRIPTION)))
        if told["format"] != FORMAT:
            raise EverystateError(
                f"{path} has format {told['format']} and this everystate reads format {FORMAT}:"
                " export the agent anew"
            )
        steps = tuple(Step(name, tuple(inputs), output) for name, inputs, output in told["steps"])
        known = {*INPUTS, *arrays, *(step.output for step in steps)}
        for step in steps:
            if step.operator not in OPERATORS or not known.issuperset(step.inputs):
                raise ValueError(f"unknown: {step}")
        return Policy(tuple(told["state_names"]), tuple(told["action_names"]), steps, arrays)
    except _PROBLEMS as error:
        raise EverystateError(
            f"{path} holds no policy ({error}): give what agent.export('NAME.npz') wrote"
        ) from error
