"""All bodies of a run in equal groups, each with its collector, wherever these are.

A collector that dies takes nothing with it: what it was doing follows from what it was given, and
another does that again.
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float32

from everystate.config import Config
from everystate.envs import BodyVectorEnv
from everystate.errors import EverystateError
from everystate.learning import episodes as ep
from everystate.learning.draws import Draws
from everystate.learning.episodes import Episodes
from everystate.learning.state import Actor
from everystate.training.bodies import Block, Bodies, EnvState, Steps, make_bodies, seed_of
from everystate.training.learner import Learner

MAX_LOSSES = 3
"""Deaths of one group's collectors in one epoch that end a run."""
_MOMENT_S = 0.2


class LostError(Exception):
    """A collector is gone, and with it what it was doing."""


class Collector(ABC):
    """Does one thing at a time of what `Bodies` do, somewhere."""

    @abstractmethod
    def begin(self, method: str, *arguments: Any) -> None:
        """Has it call that method of its bodies."""

    @abstractmethod
    def wait(self, seconds: float) -> bool:
        """Whether it is done, or lost, after so long at most."""

    @abstractmethod
    def result(self) -> Any:
        """What came of it.

        Raises:
            LostError: nothing did.
        """


class Crew(ABC):
    """Where collectors come from."""

    @abstractmethod
    def hire(self, config: Config, groups: Sequence[int]) -> list[Collector]:
        """A new collector for each of these groups.

        Raises:
            LostError: one was lost while it began.
            EverystateError: there is no place for it, or it is of another kind than this process.
        """

    @abstractmethod
    def share(self, value: Any) -> Any:
        """What stands for a value that many collectors are given."""


class Collected(NamedTuple):
    """An epoch of all bodies, and where it left them."""

    steps: Steps
    observations: Float32[np.ndarray, "bodies s"]
    env: tuple[EnvState, ...]
    """Of each group."""


class Groups:
    """The collectors of a run, and how work is divided among them.

    `interrupted` is asked every moment; what it stops returns None and can be forgotten.
    """

    def __init__(self, config: Config, crew: Crew, interrupted: Callable[[], bool]) -> None:
        self._config, self._crew, self._interrupted = config, crew, interrupted
        self._count = number_of(config)
        self._collectors: dict[int, Collector] = {}
        self._placed: set[int] = set()
        """Groups whose bodies stand where the last epoch left them."""

    def start(self, actions: Float32[np.ndarray, "steps bodies a"]) -> Collected | None:
        """New initial states for all bodies, and what came of these actions there."""
        shares = self._divided(actions)
        blocks = self._all("start", lambda i: (shares[i], seed_of(self._config, i)))
        return None if blocks is None else _joined(blocks)

    def collect(
        self,
        actor: Actor,
        episodes: Episodes,
        draws: Draws,
        observations: Float32[np.ndarray, "bodies s"],
        env: Sequence[EnvState],
    ) -> tuple[Collected, Episodes] | None:
        """One epoch of steps of all bodies; see `Bodies.collect`, which each group does."""
        sent = self._crew.share(_on_host(actor))
        drawn = self._divided(_on_host(draws))
        of_group = _on_host(ep.parts(episodes, self._count))
        seen = np.split(observations, self._count)

        def arguments(group: int) -> tuple[Any, ...]:
            state = None if group in self._placed else env[group]
            return sent, of_group[group], drawn[group], seen[group], state

        done = self._all("collect", arguments)
        if done is None:
            return None
        blocks, parts = zip(*done, strict=True)
        return _joined(blocks), ep.joined(parts)

    def _divided(self, tree: Any) -> list[Any]:
        """Each group's share of arrays [steps, bodies, ...]."""
        size = size_of(self._config)
        shares = [slice(i * size, (i + 1) * size) for i in range(self._count)]
        return [jax.tree.map(itemgetter((slice(None), share)), tree) for share in shares]

    def _all(self, method: str, arguments: Callable[[int], tuple[Any, ...]]) -> list[Any] | None:
        """What came of it for each group, done as often as it takes."""
        waiting, results, losses = set(range(self._count)), {}, Counter[int]()
        self._begin(waiting, method, arguments, losses)
        while waiting:
            if self._interrupted():
                return None
            lost, until = set(), _MOMENT_S
            for group in sorted(waiting):
                if not self._collectors[group].wait(until):
                    until = 0.0
                    continue
                try:
                    results[group] = self._collectors[group].result()
                except LostError as error:
                    self._mourn(group, losses, error)
                    lost.add(group)
                else:
                    waiting.remove(group)
            self._begin(lost, method, arguments, losses)
        if None in results.values():
            return None  # It was interrupted where it was.
        self._placed = set(results)
        return [results[group] for group in sorted(results)]

    def _begin(
        self,
        groups: set[int],
        method: str,
        arguments: Callable[[int], tuple[Any, ...]],
        losses: Counter[int],
    ) -> None:
        while missing := sorted(groups - self._collectors.keys()):
            try:
                hired = self._crew.hire(self._config, missing)
            except LostError as error:
                self._mourn(missing[0], losses, error)
                continue
            self._collectors |= zip(missing, hired, strict=True)
        for group in groups:
            self._collectors[group].begin(method, *arguments(group))
            self._placed.discard(group)

    def _mourn(self, group: int, losses: Counter[int], error: LostError) -> None:
        self._collectors.pop(group, None)
        self._placed.discard(group)
        losses[group] += 1
        if losses[group] >= MAX_LOSSES:
            raise EverystateError(
                f"collector {group} was lost {MAX_LOSSES} times in one epoch (the last time:"
                f" {error}): see to its node; the same command goes on from the last checkpoint"
            ) from error


class InProcess(Crew):
    """A crew that is this process: its collectors work one after the other, when waited for."""

    def __init__(
        self,
        learner: Learner,
        first: BodyVectorEnv,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        """The first group has the bodies given."""
        self._learner, self._first, self._interrupted = learner, first, interrupted

    def hire(self, config: Config, groups: Sequence[int]) -> list[Collector]:
        envs = [make_bodies(config, size_of(config)) if group else self._first for group in groups]
        return [_Here(Bodies(env, self._learner, self._interrupted)) for env in envs]

    def share(self, value: Any) -> Any:
        return value


class _Here(Collector):
    def __init__(self, bodies: Bodies) -> None:
        self._bodies, self._task = bodies, lambda: None

    def begin(self, method: str, *arguments: Any) -> None:
        self._task = lambda: getattr(self._bodies, method)(*arguments)

    def wait(self, seconds: float) -> bool:
        return True

    def result(self) -> Any:
        return self._task()


def number_of(config: Config) -> int:
    """How many groups there are."""
    return max(config.collectors, 1)


def size_of(config: Config) -> int:
    """How many bodies a group has."""
    return config.num_bodies // number_of(config)


def _joined(blocks: Sequence[Block]) -> Collected:
    steps, observations, env = zip(*blocks, strict=True)
    columns = (np.concatenate(column, axis=1) for column in zip(*steps, strict=True))
    return Collected(Steps(*columns), np.concatenate(observations), env)


def _on_host(tree: Any) -> Any:
    return jax.tree.map(lambda x: np.asarray(x) if isinstance(x, jax.Array) else x, tree)
