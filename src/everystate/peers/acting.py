"""What is kept of every agent that is scored: what it needs to act again, and nothing to learn.

Ours is an export with matrices of float16. A peer's is one file, `actor.safetensors`: its network's
layers, matrices as float16, and the units of its inputs; NumPy runs it, PyTorch is not needed.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy
from jaxtyping import Float, Float32

from everystate.agent import load as load_ours
from everystate.errors import EverystateError
from everystate.evaluation import Agent, DoNothing, RandomActions
from everystate.peers.agents import PeerConfig

_FILE = "actor.safetensors"


@dataclass(frozen=True)
class Actor:
    """A network of a peer as an evaluation wants it: rectified layers, and a tanh in the end."""

    config: PeerConfig
    inputs: tuple[str, ...]
    """What the network takes, one beside the other: observation, achieved_goal, desired_goal."""
    shift: Float32[np.ndarray, " inputs"]
    scale: Float32[np.ndarray, " inputs"]
    """An input is (what it is in the body's units - shift) / scale, held within `clip`, if any."""
    clip: float | None
    weights: tuple[Float32[np.ndarray, "_ _"], ...]
    biases: tuple[Float32[np.ndarray, " _"], ...]
    estimate: Callable[[Any, Any], Float32[np.ndarray, "*n"]] | None = None
    """Of steps to a goal, by a critic, which is not kept."""

    def act(
        self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0
    ) -> Float32[np.ndarray, "*n action"]:
        """What the policy does without its noise; it cannot plan."""
        states, goals = np.broadcast_arrays(observation, goal)
        asked = {"observation": states, "achieved_goal": states, "desired_goal": goals}
        x = np.concatenate([asked[name] for name in self.inputs], axis=-1)
        x = ((x - self.shift) / self.scale).astype(np.float32)
        x = x if self.clip is None else np.clip(x, -self.clip, self.clip)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.maximum(x @ weight.T + bias, 0)
        return np.tanh(x @ self.weights[-1].T + self.biases[-1])

    def steps_to_goal(self, observation: Any, goal: Any) -> Float32[np.ndarray, "*n"]:
        """NaN where there is no critic to ask."""
        if self.estimate is None:
            return np.full(np.shape(observation)[:-1], np.nan, dtype=np.float32)
        return self.estimate(observation, goal)


def write(actor: Actor, folder: Path) -> None:
    """Into a new folder."""
    arrays: dict[str, Float[np.ndarray, "..."]] = {"shift": actor.shift, "scale": actor.scale}
    for i, (weight, bias) in enumerate(zip(actor.weights, actor.biases, strict=True)):
        arrays |= {f"weight{i}": weight.astype(np.float16), f"bias{i}": bias}
    about = {"config": asdict(actor.config), "inputs": actor.inputs, "clip": actor.clip}
    folder.mkdir(parents=True)
    safetensors.numpy.save_file(arrays, folder / _FILE, {"actor": json.dumps(about)})


def read(folder: Path) -> Actor:
    """The inverse of `write`, but for what float16 rounds off."""
    try:
        with safetensors.safe_open(folder / _FILE, "numpy") as file:
            about = json.loads(file.metadata()["actor"])
            arrays = {name: file.get_tensor(name).astype(np.float32) for name in file.keys()}  # noqa: SIM118
        layers = range(sum(name.startswith("weight") for name in arrays))
        options = tuple(about["config"].pop("body_options"))
        return Actor(
            config=PeerConfig(**about["config"], body_options=options),
            inputs=tuple(about["inputs"]),
            shift=arrays["shift"],
            scale=arrays["scale"],
            clip=about["clip"],
            weights=tuple(arrays[f"weight{i}"] for i in layers),
            biases=tuple(arrays[f"bias{i}"] for i in layers),
        )
    except (OSError, ValueError, KeyError, TypeError, safetensors.SafetensorError) as error:
        problem = " ".join(f"{type(error).__name__}: {error}".split())
        raise EverystateError(f"{folder / _FILE} is damaged ({problem}): train it again") from error


def load(folder: Path, config: PeerConfig) -> Agent:
    """The agent kept in a folder, or one that does not learn, of which nothing is kept.

    Raises:
        EverystateError: nothing is there, or what is there is damaged.
    """
    if config.agent == "random":
        return RandomActions(config, config.seed)
    if config.agent == "nothing":
        return DoNothing(config)
    if (folder / _FILE).exists():
        return read(folder)
    if not folder.exists():
        raise EverystateError(f"{folder} is missing, and with it how to act: train it again")
    return load_ours(folder)


def checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of what is kept, by file; empty where nothing is."""
    files = sorted(folder.iterdir()) if folder.exists() else []
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
