"""A short run of what `kill_runs.py` does a hundred times."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    ("kills", "compiled"), [(5, "quickly"), pytest.param(10, "as users do", marks=pytest.mark.slow)]
)
def test_a_run_that_is_killed_ends_as_if_it_had_not_been(
    pytestconfig: pytest.Config, as_users: dict[str, str], kills: int, compiled: str
) -> None:
    script = Path(__file__).with_name("trust") / "kill_runs.py"
    # With a cache of everystate's own, as users have it: traced programs are kept too.
    environment = dict(os.environ) if compiled == "quickly" else as_users
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    assert pytestconfig.cache is not None
    environment["EVERYSTATE_CACHE"] = str(pytestconfig.cache.mkdir("everystate"))
    done = subprocess.run(
        [sys.executable, script, str(kills)], capture_output=True, text=True, env=environment
    )
    assert done.returncode == 0, done.stdout + done.stderr[-2_000:]
    said = json.loads(done.stdout.splitlines()[-1])
    assert sum(said["during"].values()) == kills
