"""A short run of what `kill_runs.py` does a hundred times."""

import json
import subprocess
import sys
from pathlib import Path


def test_a_run_that_is_killed_five_times_ends_as_if_it_had_not_been() -> None:
    script = Path(__file__).with_name("kill_runs.py")
    done = subprocess.run([sys.executable, script, "5"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr[-2_000:]
    said = json.loads(done.stdout.splitlines()[-1])
    assert sum(said["during"].values()) == 5
