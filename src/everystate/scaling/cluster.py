"""Ray, for as long as it is needed: on this machine alone, or a cluster that runs already."""

import logging
import os
import socket
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from threading import Event
from typing import Any

from everystate.errors import EverystateError

_SETTINGS = {
    "RAY_USAGE_STATS_ENABLED": "0",  # Nothing of a run is told to anyone.
    # By default its workers stand back for whatever else runs, and all but stop beside it.
    "RAY_worker_niceness": "0",
}
_RETRIES, _LOOK_S = 2, 0.5


@contextmanager
def connected(address: str | None, cpus: int) -> Iterator[None]:
    """Connects to Ray, and leaves it, or stops it if it is this machine's own.

    Args:
        address: of a cluster's head, HOST:PORT; or "auto", for that of this machine. None starts
            Ray on this machine alone, unless whoever calls has started it and will stop it.
        cpus: how many processes Ray may have at work when it is started here.

    Raises:
        EverystateError: Ray is not installed, or there is no such cluster.
    """
    if find_spec("ray") is None:
        raise EverystateError(
            "Ray is not installed: pip install ray, which is of everystate's extra `scale`"
        )
    for name, value in _SETTINGS.items():
        os.environ.setdefault(name, value)
    import ray

    if ray.is_initialized() and address is None:
        yield
        return
    where: dict[str, Any] = {"address": address}
    if address is None:
        where = {"address": "local", "num_cpus": cpus, "include_dashboard": False}
    elif address != "auto" and "://" not in address and not answers(address):
        # Ray itself would try for minutes.
        raise EverystateError(
            f"no Ray cluster answers at {address}: give HOST:PORT as `ray start --head` prints it,"
            " or leave --ray-address out to use this machine alone"
        )
    try:
        with warnings.catch_warnings():
            # JAX warns of forks; Ray's children run other programs at once.
            warnings.filterwarnings("ignore", r"os\.fork", RuntimeWarning)
            ray.init(**where, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        # Ray's own message, of which other versions of Ray or Python are one.
        raise EverystateError(
            f"no Ray cluster can be used at {address or 'this machine'} ({line(error)}): start"
            " one by `ray start --head`, or leave --ray-address out to use this machine alone"
        ) from error
    try:
        yield
    finally:
        ray.shutdown()


def elsewhere(work: Callable[..., Any], *arguments: Any, stopped: Event) -> Any:
    """What a function returns on a node of the cluster, where it has a CPU to itself.

    If the node is lost, it is called again on another. Setting `stopped` interrupts it.

    Raises:
        EverystateError: the function raised something, or was lost too often.
    """
    import ray
    from ray.exceptions import RayError

    task = ray.remote(num_cpus=1, max_retries=_RETRIES)(work).remote(*arguments)
    try:
        while not ray.wait([task], timeout=_LOOK_S)[0]:
            if stopped.is_set():
                ray.cancel(task, force=True)
                raise KeyboardInterrupt
        return ray.get(task)
    except RayError as error:
        raise EverystateError(f"Ray failed ({line(error)}): the same command goes on") from error


def answers(address: str) -> bool:
    """Whether anyone listens at HOST:PORT."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=5).close()
    except (OSError, ValueError):
        return False
    return True


def line(error: BaseException) -> str:
    """An error of Ray's in short."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]
