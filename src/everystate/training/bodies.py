"""A group of bodies that act: all of a run's, or those that one of its collectors has."""

import shutil
from collections.abc import Callable
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float32

from everystate import envs
from everystate.agent import BodyInfo, with_model_copy
from everystate.agent.files import BODY
from everystate.config import Config
from everystate.envs import BodyVectorEnv
from everystate.errors import EverystateError
from everystate.learning.draws import Draws
from everystate.learning.episodes import Episodes
from everystate.learning.state import Actor
from everystate.training.learner import Learner

EnvState = dict[str, np.ndarray]


class Steps(NamedTuple):
    """Transitions as the bodies saw them, in their own units."""

    observations: Float32[np.ndarray, "steps bodies s"]
    actions: Float32[np.ndarray, "steps bodies a"]
    next_observations: Float32[np.ndarray, "steps bodies s"]
    goals: Float32[np.ndarray, "steps bodies s"]
    """Where the bodies were going; of a warm-up, where they came."""


class Block(NamedTuple):
    """What came of an epoch of a group, and where it left the bodies."""

    steps: Steps
    observations: Float32[np.ndarray, "bodies s"]
    env: EnvState
    """The bodies' physics and random numbers, as their `get_state` has it."""


def make_bodies(config: Config, count: int) -> BodyVectorEnv:
    """So many bodies of a run, a step of which is its `interval`."""
    options = envs.parse_options(config.body_options)
    options["action_repeat"] = options.get("action_repeat", 1) * max(config.interval, 1)
    return envs.make(config.body, count, config.seed, **options)


def info(config: Config, env: BodyVectorEnv) -> BodyInfo:
    """What a run and its agent keep of a body."""
    names, versions = tuple(env.state_names), envs.versions(config.body)
    return BodyInfo(
        names, len(env.action_names), env.model_hash, versions, env.action_names, env.horizontal
    )


def with_own_copy(config: Config, env: BodyVectorEnv, run: Path) -> Config:
    """The config of a run, with its body built from the copy in the run's folder from now on.

    The copy is made if there is none yet. Bodies of packages are left as they are.

    Args:
        config: of the run.
        env: the body as it is now, outside of the run's folder.
        run: the run's folder, which was begun with such a body.

    Raises:
        EverystateError: the copy was lost or changed, or the model cannot be copied.
    """
    model, copy = envs.own_model(env), run / BODY
    if model is None:
        return config
    if not copy.exists():
        if any(run.glob("checkpoints/[0-9]*")):
            raise EverystateError(
                f"{copy} is missing, the copy of {model} that the run learned on: choose another"
                " --run-dir"
            )
        draft = run / f".{BODY}.draft"
        shutil.rmtree(draft, ignore_errors=True)
        envs.copy_model(model, draft)
        draft.rename(copy)
    config = with_model_copy(config, copy)
    if make_bodies(config, 1).model_hash != env.model_hash:
        raise EverystateError(
            f"{copy} does not compile to the same model as {model}: choose another --run-dir"
        )
    return config


def seed_of(config: Config, group: int) -> int:
    """Of what is random in a group's bodies; the only or first group has the run's own."""
    # Seeds of runs end below 2^31, so that no group of one run is a group of another.
    return config.seed + group * 2**31


class Bodies:
    """Bodies, what makes them act, and nothing of the agent that outlives an epoch."""

    def __init__(
        self,
        env: BodyVectorEnv,
        learner: Learner,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        self._env, self._learner, self._interrupted = env, learner, interrupted

    def start(self, actions: Float32[np.ndarray, "steps bodies a"], seed: int) -> Block:
        """New initial states, and what came of these actions there."""
        observations, _ = self._env.reset(seed=seed)
        taken = []
        for action in actions:
            reached, after = _step(self._env, action)
            taken.append((observations, action, reached, reached))
            observations = after
        return Block(_stacked(taken), observations, self._env.get_state())

    def collect(
        self,
        actor: Actor,
        episodes: Episodes,
        draws: Draws,
        observations: Float32[np.ndarray, "bodies s"],
        state: EnvState | None = None,
    ) -> tuple[Block, Episodes] | None:
        """One epoch of steps; None if interrupted.

        Given all arguments, the result depends on nothing else: who does it again, elsewhere,
        gets the same. Bodies that are without `exact_restore` start anew then.

        Args:
            actor: acts throughout.
            episodes: of these bodies, their tally clear.
            draws: [steps, bodies, ...].
            observations: what the bodies observe now.
            state: puts the bodies there first; None where they are there already.
        """
        if state is not None:
            self._env.set_state(state)
            if not self._env.exact_restore:
                observations = self._env.reset()[0]
        # What an epoch begins with comes from anywhere; all on one device, it is compiled once.
        actor, episodes = jax.tree.map(_placed, (actor, episodes))
        draws, taken = jax.device_get(draws), []
        centre, spread = map(np.asarray, actor.scale)
        for step in range(len(draws.goals)):
            if self._interrupted():
                return None
            now = jax.tree.map(itemgetter(step), draws)
            episodes, acted = self._learner.act(actor, episodes, now, observations)
            actions = np.asarray(acted)
            reached, after = _step(self._env, actions)
            goals = np.asarray(episodes.goals) * spread + centre
            taken.append((observations, actions, reached, goals))
            observations = after
        return Block(_stacked(taken), observations, self._env.get_state()), episodes


def _placed(leaf: object) -> object:
    is_array = isinstance(leaf, jax.Array | np.ndarray)
    return jax.device_put(leaf, jax.devices()[0]) if is_array else leaf


def _step(
    env: BodyVectorEnv, actions: np.ndarray
) -> tuple[Float32[np.ndarray, "bodies s"], Float32[np.ndarray, "bodies s"]]:
    """What the actions led to, and from where the bodies go on: elsewhere if they came to an end.

    So no transition leads across an end, and a chain of transitions shows where it is broken.
    """
    after, _, _, _, info = env.step(actions)
    return info.get("final_obs", after), after


def _stacked(taken: list[tuple[np.ndarray, ...]]) -> Steps:
    return Steps(*(np.stack(column) for column in zip(*taken, strict=True)))
