"""Short runs of the fuzzing, in processes where types are not checked, as with users."""

import subprocess
import sys
from pathlib import Path


def test_no_damage_to_a_file_is_a_traceback() -> None:
    script = Path(__file__).with_name("trust") / "fuzz_files.py"
    done = subprocess.run([sys.executable, script, "15"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2_000:]
    assert done.stdout.count("none of them a traceback") == 9


def test_no_command_line_is_a_traceback() -> None:
    script = Path(__file__).with_name("trust") / "fuzz_commands.py"
    done = subprocess.run([sys.executable, script, "100"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2_000:]
    assert "none of them a traceback" in done.stdout
