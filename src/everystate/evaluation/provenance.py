"""What a result file says about where it comes from: command, commit, machine, versions."""

import os
import platform
import re
import shlex
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

_PACKAGES = ("everystate", "jax", "equinox", "flowjax", "mujoco", "numpy")
_THREADS = ("OMP_NUM_THREADS", "XLA_FLAGS")


def provenance() -> dict[str, Any]:
    """Where a measurement of this process comes from, as the fields that a raw result has.

    `clean` says whether all files of the checkout but results/ and docs/ are as committed; it and
    `commit` are None outside a checkout. `usable_cores` are those this process may run on.
    """
    return {
        "command": command(),
        "argv": argv(),
        "commit": commit(),
        "clean": clean(),
        "machine": {
            "cpu": _cpu(),
            "cores": os.cpu_count(),
            "usable_cores": len(usable_cores()),
            "threads": {name: os.environ.get(name) for name in _THREADS},
            "system": platform.system(),
        },
        "versions": {"python": platform.python_version()} | _versions(),
    }


def usable_cores() -> list[int]:
    """Those that this process may run on; all, where the system does not say."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def argv() -> list[str]:
    """This process's words, as one would type them again.

    Of an absolute path only the last name is kept, after `.../`: the folders before it are of one
    machine, and would have to be edited out later.
    """
    program, spec = Path(sys.argv[0]), sys.modules["__main__"].__spec__
    if spec is not None:  # by `python -m`
        module = spec.name.removesuffix(".__main__")
        typed = [module] if module == "everystate" else ["python", "-m", module]
    elif program.suffix == ".py":
        typed = ["python", sys.argv[0]]
    else:
        typed = [program.name]
    return [re.sub(r"(^|=)/(?:.*/)?([^/]+)/*$", r"\1.../\2", word) for word in typed + sys.argv[1:]]


def command() -> str:
    """`argv` as one line for a shell."""
    return shlex.join(argv())


def commit() -> str | None:
    """The commit this package is checked out at."""
    return _git("rev-parse", "HEAD")


def clean() -> bool | None:
    """Whether the checkout's files are as committed; results/ and docs/ count for nothing."""
    changed = _git(
        "status", "--porcelain", "--", ":/", ":(top,exclude)results", ":(top,exclude)docs"
    )
    return None if changed is None else not changed


def _git(*arguments: str) -> str | None:
    def run(*words: str) -> str:
        git = ("git", "-C", str(Path(__file__).parents[1]), *words)
        done = subprocess.run(git, capture_output=True, text=True, check=True, timeout=10)
        return done.stdout.strip()

    try:
        # An installed package may lie inside somebody's checkout, whose commit says nothing of it.
        run("ls-files", "--error-unmatch", "__init__.py")
        return run(*arguments)
    except (OSError, subprocess.SubprocessError):
        return None


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def _versions() -> dict[str, str]:
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # run from a source tree that was never installed
            continue
    return found
