"""What a result file says about where it comes from: command, commit, machine, versions."""

import os
import platform
import shlex
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

_PACKAGES = ("everystate", "jax", "equinox", "flowjax", "mujoco", "numpy")


def provenance() -> dict[str, Any]:
    """Command line, commit (None outside a checkout), machine and versions."""
    return {
        "command": command(),
        "commit": commit(),
        "machine": {"cpu": _cpu(), "cores": os.cpu_count(), "system": platform.system()},
        "versions": {"python": platform.python_version()} | _versions(),
    }


def command() -> str:
    """This process's command line, as one would type it again."""
    program, spec = Path(sys.argv[0]), sys.modules["__main__"].__spec__
    if spec is not None:  # by `python -m`
        module = spec.name.removesuffix(".__main__")
        typed = [module] if module == "everystate" else ["python", "-m", module]
    elif program.suffix == ".py":
        typed = ["python", sys.argv[0]]
    else:
        typed = [program.name]
    return shlex.join([*typed, *sys.argv[1:]])


def commit() -> str | None:
    """The commit this package is checked out at, with `+` after it when files have changed."""
    package = Path(__file__).parents[1]

    def git(*arguments: str) -> str:
        command = ("git", "-C", str(package), *arguments)
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
        return done.stdout.strip()

    try:
        # An installed package may lie inside somebody's checkout, whose commit says nothing of it.
        git("ls-files", "--error-unmatch", "__init__.py")
        changed = git("status", "--porcelain", "--untracked-files=no", ".")
        return git("rev-parse", "HEAD") + ("+" if changed else "")
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
