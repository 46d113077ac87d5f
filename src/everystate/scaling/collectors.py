"""Collectors that are actors of a Ray cluster.

What goes there: once an epoch the weights that act, to each group what was drawn for it, and where
its episodes stand. What comes back: one block of transitions, and the state of the bodies.
"""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from everystate.config import Config
from everystate.errors import EverystateError
from everystate.scaling.cluster import answers, connected, line
from everystate.scaling.station import Station, versions
from everystate.training.groups import Collector, Crew, LostError

START_S = 300.0
"""Seconds in which at least one more collector must have come up; a busy node takes minutes."""
_PROBE_S = 2.0


@contextmanager
def on_ray(collectors: int, address: str | None = None) -> Iterator[Crew]:
    """A crew on a Ray cluster, for `everystate.train(..., crew=crew)`.

    Args:
        collectors: how many there will be, each of which takes a CPU.
        address: of the cluster's head, HOST:PORT; or "auto", for that of this machine. None starts
            Ray on this machine alone, and stops it in the end.

    Raises:
        EverystateError: Ray is not installed, or there is no such cluster.
    """
    with connected(address, collectors):
        yield RayCrew(collectors)


class RayCrew(Crew):
    """Hires actors."""

    def __init__(self, collectors: int) -> None:
        import ray

        cpus = ray.cluster_resources().get("CPU", 0)
        if cpus < collectors:
            raise EverystateError(
                f"{collectors} collectors take a CPU each, and the cluster has {cpus:g}: start more"
                " nodes, or choose fewer --collectors"
            )
        self._collectors = collectors
        self._head = ray.get_runtime_context().gcs_address
        # One that dies is replaced by ours: only `Groups` knows where its bodies stood.
        self._kind = ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(Station)

    def hire(self, config: Config, groups: Sequence[int]) -> list[Collector]:
        hired = [_Actor(self._kind.remote(), self._head, group) for group in groups]
        try:
            for actor in hired:
                actor.ask("versions")
            self._await(hired)
            for actor in hired:
                _require_alike(actor.number, *actor.result())
                actor.ask("open", config)
            self._await(hired)
            for actor in hired:
                actor.result()
        except BaseException:
            for actor in hired:
                actor.dismiss()
            raise
        return list(hired)

    def share(self, value: Any) -> Any:
        import ray

        return ray.put(value)

    def _await(self, hired: Sequence["_Actor"]) -> None:
        waiting, since = list(hired), time.monotonic()
        while waiting:
            waiting[0].wait(0.2)
            still = [actor for actor in waiting if not actor.wait(0.0)]
            if len(still) < len(waiting):
                since = time.monotonic()
            elif time.monotonic() - since > START_S:
                raise EverystateError(
                    f"collector {still[0].number} has not come up in {START_S:g} s: each of the"
                    f" {self._collectors} takes a CPU of the cluster; start more nodes, and the"
                    " same command goes on"
                )
            waiting = still


class _Actor(Collector):
    """One of them, as `Groups` know it."""

    def __init__(self, actor: Any, head: str, number: int) -> None:
        self._actor, self._head, self.number = actor, head, number
        self._task: Any = None
        self._probed = time.monotonic()

    def begin(self, method: str, *arguments: Any) -> None:
        self.ask("do", method, *arguments)

    def ask(self, method: str, *arguments: Any) -> None:
        self._task = getattr(self._actor, method).remote(*arguments)

    def wait(self, seconds: float) -> bool:
        import ray

        # Ray itself would wait for a lost head, and then end this process. Actors work on without
        # it, so one that answers at once is no sign of it.
        if time.monotonic() - self._probed > _PROBE_S:
            self._probed = time.monotonic()
            if not answers(self._head):
                raise _headless(self._head)
        return bool(ray.wait([self._task], timeout=seconds)[0])

    def result(self) -> Any:
        import ray
        from ray import exceptions

        try:
            return ray.get(self._task)
        except exceptions.RayTaskError as error:
            if isinstance(error.cause, EverystateError):
                raise error.cause from error
            raise EverystateError(
                f"the bodies of collector {self.number} failed ({line(error.cause)}): once that is"
                " mended, the same command goes on from the last checkpoint"
            ) from error
        except (
            exceptions.RayActorError,
            exceptions.WorkerCrashedError,
            exceptions.NodeDiedError,
            exceptions.ObjectLostError,
        ) as error:
            self.dismiss()
            if not answers(self._head):
                raise _headless(self._head) from error
            raise LostError(line(error)) from error
        except exceptions.RayError as error:
            raise EverystateError(
                f"Ray failed ({line(error)}): the same command goes on from the last checkpoint"
            ) from error

    def dismiss(self) -> None:
        """Ends it, lest two act on one group's bodies."""
        import ray
        from ray.exceptions import RayError

        with suppress(RayError, ValueError):
            ray.kill(self._actor)


def _headless(address: str) -> EverystateError:
    return EverystateError(
        f"the head of the Ray cluster at {address} no longer answers: once there is one again, the"
        " same command goes on from the last checkpoint"
    )


def _require_alike(number: int, node: str, there: dict[str, str]) -> None:
    differing = [
        f"{name} {there.get(name)} there and {here} here"
        for name, here in versions().items()
        if there.get(name) != here
    ]
    if differing:
        raise EverystateError(
            f"collector {number} is on a node of other versions, {node} ({'; '.join(differing)}):"
            " install the same on every node"
        )
