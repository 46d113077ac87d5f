"""Collection: bodies that act, first at random and then as the agent says."""

import zipfile
import zlib
from pathlib import Path

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32

from everystate.agent import own
from everystate.config import Config
from everystate.envs import BodyVectorEnv
from everystate.errors import EverystateError
from everystate.learning.models import Scale
from everystate.learning.replay import Transitions
from everystate.learning.state import AgentState
from everystate.learning.units import of_warm_up
from everystate.training import coverage, hosts
from everystate.training.bodies import Steps, info
from everystate.training.checkpoint import Snapshot
from everystate.training.groups import Collected, Groups
from everystate.training.learner import Learner, begin

MAX_SAMPLES = 500
_LARGEST_SAMPLES = 1 << 28
"""Bytes: 500 states and 100,000 goals of 256 components, and the cells."""


def warm_up(config: Config, env: BodyVectorEnv, groups: Groups) -> Snapshot | None:
    """A new run: uniformly random actions (Algorithm 1 needs some transitions), fresh models.

    Returns:
        What the run begins with; None if interrupted.
    """
    rng = np.random.default_rng([config.seed, zlib.crc32(b"warm-up")])
    shape = config.warmup_steps, config.num_bodies, action_size(env)
    collected = groups.start(rng.uniform(-1, 1, shape).astype(np.float32))
    if collected is None:
        return None
    steps = collected.steps
    scale = Scale(jnp.asarray(env.scaling.centre), jnp.asarray(env.scaling.spread))
    space = info(config, env).space
    if config.units == "running":
        scale = of_warm_up(jnp.asarray(steps.next_observations), space.turned(config))
    agent = begin(config, space, to_device(steps), scale)
    visited = coverage.visit(coverage.no_cells(*bounds(env)), steps.next_observations, *bounds(env))
    return Snapshot(agent, collected.env, collected.observations, visited)


def collect(
    learner: Learner, groups: Groups, snapshot: Snapshot
) -> tuple[AgentState, Collected] | None:
    """One epoch of steps of all bodies; None if interrupted.

    The snapshot stays as it is: an interrupted epoch can be forgotten.
    """
    agent = hosts.local(snapshot.agent)
    actor, draws = agent.actor, learner.draw(agent)
    done = groups.collect(actor, agent.episodes, draws, snapshot.observations, snapshot.env)
    if done is None:
        return None
    collected, episodes = done
    return snapshot.agent._replace(episodes=jax.tree.map(own, episodes)), collected


def world_metrics(
    config: Config, env: BodyVectorEnv, steps: Steps, snapshot: Snapshot
) -> dict[str, int | float]:
    """What an epoch looked like from outside the agent."""
    fell = env.falls(steps.observations, steps.next_observations)
    count = config.warmup_steps + snapshot.epoch * config.steps_per_epoch
    metrics = {
        "steps": count * config.num_bodies * config.interval,
        "env/falls_per_1000": 1000 * float(fell.mean()) / config.interval,
    }
    if snapshot.visited.size:
        metrics["coverage/cells"] = float(snapshot.visited.mean())
    return metrics


def save_samples(folder: Path, steps: Steps, snapshot: Snapshot) -> None:
    """For pictures: some states of the epoch, every body's goal, and the cells visited so far."""
    states = steps.next_observations.reshape(-1, steps.next_observations.shape[-1])
    chosen = np.linspace(0, len(states) - 1, min(len(states), MAX_SAMPLES)).astype(int)
    centre, spread = (np.asarray(x) for x in snapshot.agent.scale)
    goals = np.asarray(snapshot.agent.episodes.goals) * spread + centre
    folder.mkdir(exist_ok=True)
    np.savez_compressed(
        folder / f"{snapshot.epoch:06d}.npz",
        next_observations=states[chosen],
        goals=goals,
        visited=snapshot.visited,
    )


def read_samples(path: Path) -> dict[str, np.ndarray]:
    """What `save_samples` wrote.

    Raises:
        EverystateError: the file is damaged, or unpacks to more than any such file.
    """
    try:
        with zipfile.ZipFile(path) as packed:
            size = sum(item.file_size for item in packed.infolist())
        if size > _LARGEST_SAMPLES:
            raise ValueError(f"it unpacks to {size} bytes, more than {_LARGEST_SAMPLES}")
        with np.load(path) as arrays:
            return {name: arrays[name] for name in ("next_observations", "goals", "visited")}
    except (
        OSError,
        ValueError,
        KeyError,
        EOFError,
        RuntimeError,  # by zipfile, of what is encrypted or packed in a way that it does not know
        zipfile.BadZipFile,
        zlib.error,
    ) as error:
        raise EverystateError(f"{path} is damaged ({type(error).__name__}: {error})") from error


def bounds(env: BodyVectorEnv) -> tuple[Float32[np.ndarray, " s"], Float32[np.ndarray, " s"]]:
    """The lowest and highest state of the body."""
    space = env.single_observation_space
    assert isinstance(space, gymnasium.spaces.Box)
    return space.low, space.high


def action_size(env: BodyVectorEnv) -> int:
    """Number of components of an action."""
    return env.action_space.shape[-1] if env.action_space.shape else 0


def to_device(steps: Steps) -> Transitions:
    """What the algorithm takes."""
    return Transitions(*map(jnp.asarray, steps))
