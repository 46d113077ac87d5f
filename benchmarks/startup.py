"""Start-up time and peak memory of a training run: `python benchmarks/startup.py [--json]`.

Starts the same run twice in fresh processes, with an empty compile cache (cold) and with the one
that the first left behind (warm), and waits for its first update's line in `metrics.jsonl`: process
start, imports, warm-up, compilation, 2,500 control steps and one update. Peak memory is the largest
resident set of either process.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import _benchmark as benchmark


def first_update_s(folder: Path, preset: str, cache: Path) -> float:
    """Seconds from starting the command until the first update is on disk."""
    command = [sys.executable, "-m", "everystate", "train", "ramp-pointmass", "--quiet"]
    command += ["--preset", preset, "--epochs", "1", "--run-dir", str(folder)]
    command += ["--num-updates", "1", "--target-period", "1"]  # an epoch of one update
    environment = os.environ | {"EVERYSTATE_CACHE": str(cache)}
    metrics = folder / "metrics.jsonl"
    started = time.perf_counter()
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) as process:
        while not (metrics.exists() and metrics.stat().st_size):
            if process.poll():
                raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
            time.sleep(0.02)
        elapsed = time.perf_counter() - started
    return elapsed


def main() -> None:
    """Measures and prints."""
    parser = benchmark.options(__doc__, preset="quick")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        result = {
            "benchmark": "startup",
            "preset": options.preset,
            "cold_s": first_update_s(place / "cold", options.preset, place / "cache"),
            "warm_s": first_update_s(place / "warm", options.preset, place / "cache"),
            "peak_memory_mb": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024,
            "machine": benchmark.machine(),
        }
    benchmark.show(result, as_json=options.json, out=options.out)


if __name__ == "__main__":
    main()
