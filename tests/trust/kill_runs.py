"""Kills a training run over and over, and loses nothing.

    python tests/trust/kill_runs.py [KILLS] [--out FILE]

A short run is killed (SIGKILL) at random moments and started again by the same command, until it
was killed so often; then it may finish. Its metrics, but for their times, and its last checkpoint
must be, bit for bit, those of a run that nobody disturbed. Moments are drawn evenly from the two
epochs, checkpoint writes included, after the first that was logged; one in eight from a start.
The last line is one JSON object, and what FILE gets: results/trust/kills.json, of 100 kills.
"""

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from everystate.evaluation import raw
from everystate.learning.models import Space
from everystate.presets import preset
from everystate.training import checkpoint
from everystate.training.checkpoint import _to_arrays
from everystate.training.logging import read_metrics

BODY = "ramp-pointmass"
STARTING_S = 5.0
"""Span of a start, from which kills during it are drawn."""


def command(run: Path, epochs: int) -> list[str]:
    words = ["train", BODY, "--preset", "test", "--epochs", str(epochs), "--run-dir", str(run)]
    return [sys.executable, "-m", "everystate", *words, "--checkpoint-period", "1", "--quiet"]


def start(run: Path, epochs: int) -> subprocess.Popen:
    return subprocess.Popen(command(run, epochs), stdout=subprocess.DEVNULL)


def moves_on(run: Path, process: subprocess.Popen) -> bool:
    """Waits until the run has logged an epoch beyond its last checkpoint; False if it ended."""
    metrics, opened = run / "metrics.jsonl", time.time()
    done = max((int(p.name) for p in (run / "checkpoints").glob("[0-9]*")), default=0)
    while process.poll() is None:
        # What was logged before the last kill is there until the run begins its file anew.
        if metrics.exists() and metrics.stat().st_mtime > opened:
            lines = read_metrics(run)
            if lines and lines[-1]["epoch"] > done:
                return True
        time.sleep(0.005)
    return False


def kill(run: Path, epochs: int, epoch_s: float, rng: random.Random) -> str | None:
    """Starts the run and kills it; says during what, or None if it ended first."""
    process = start(run, epochs)
    starting = rng.random() < 1 / 8
    if not starting and not moves_on(run, process):
        return None
    time.sleep(rng.uniform(0, STARTING_S if starting else 2 * epoch_s))
    if process.poll() is not None:
        return None
    process.kill()
    process.wait()
    if list((run / "checkpoints").glob(".draft-*")):
        return "a checkpoint write"
    return "its start" if starting else "an epoch"


def timeless(run: Path) -> list[dict]:
    lines = read_metrics(run)
    return [{k: x for k, x in line.items() if not k.startswith("time/")} for line in lines]


def last_state(run: Path, epochs: int) -> dict[str, np.ndarray]:
    config = preset("test", BODY, epochs=epochs, checkpoint_period=1)
    snapshot = checkpoint.restore(run / "checkpoints", config, Space(2, 2))
    assert snapshot is not None
    return _to_arrays(snapshot)


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("kills", type=int, nargs="?", default=100)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    kills: int = options.kills
    epochs, rng = 4 * kills + 5, random.Random(kills)
    os.environ["JAX_PLATFORMS"] = "cpu"
    during = {"its start": 0, "an epoch": 0, "a checkpoint write": 0}
    with tempfile.TemporaryDirectory() as name:
        straight, killed = Path(name) / "straight", Path(name) / "killed"
        assert start(straight, epochs).wait() == 0
        times = [line["time/elapsed_s"] for line in read_metrics(straight)]
        epoch_s = float(np.median(np.diff(times)))
        for _ in range(kills):
            moment = kill(killed, epochs, epoch_s, rng)
            if moment is None:
                raise SystemExit("the run ended before it was killed often enough")
            during[moment] += 1
        assert start(killed, epochs).wait() == 0
        same = timeless(straight) == timeless(killed)
        one, other = last_state(straight, epochs), last_state(killed, epochs)
        differing = [n for n in one if one[n].tobytes() != other[n].tobytes()]
        damaged = [p.name for p in (killed / "checkpoints").glob("damaged-*")]
    same_state = one.keys() == other.keys() and not differing
    said = {"kills": kills, "during": during, "epochs": epochs, "same_metrics": same}
    said |= {"same_state": same_state, "damaged_checkpoints": len(damaged)}
    print(json.dumps(said))
    if options.out is not None:
        raw.write(options.out, said, replace=True)
    if not (same and same_state) or damaged:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
