"""A million environment steps with learning: does a long run stay as it began?

    python tests/trust/soak.py [STEPS]

Trains the Ramp Pointmass by small models, and looks once a second from outside at the process:
resident memory, open files, threads, and processor time. `results/soak/soak.json` gets their
medians over each tenth of the run, and of the seconds an epoch took, on the clock and of processors
(which other work on the machine does not lengthen so much); `soak.png` shows them.
"""

import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import matplotlib.pyplot as plt

from everystate.evaluation import raw
from everystate.training.logging import read_metrics

RESULTS = Path(__file__).resolve().parents[2] / "results" / "soak"
PER_EPOCH = 2_500
OPTIONS = (
    "--preset test --num-bodies 50 --steps-per-epoch 50 --capacity 100000 --width 32"
    " --num-updates 20 --target-period 10 --checkpoint-period 20 --quiet"
)
SHOWN = {
    "memory_mb": "resident memory, MB",
    "files": "open files",
    "threads": "threads",
    "epoch_s": "seconds an epoch",
    "epoch_cpu_s": "processor seconds an epoch",
}


def look(pid: int, run: Path) -> dict[str, float] | None:
    """What the kernel says of a process, and its run's epochs, or None once it has ended."""
    place = Path(f"/proc/{pid}")
    try:
        pages = int((place / "statm").read_text().split()[1])
        ticks = (place / "stat").read_text().rpartition(")")[2].split()[11:13]
        return {
            "epochs": len(read_metrics(run)),
            "cpu_s": sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK"),
            "memory_mb": pages * os.sysconf("SC_PAGE_SIZE") / 2**20,
            "files": len(list((place / "fd").iterdir())),
            "threads": len(list((place / "task").iterdir())),
        }
    except (OSError, IndexError):
        return None


def soak(epochs: int, run: Path) -> tuple[list[dict[str, float]], list[float]]:
    """Looks during the run, and the seconds of every epoch."""
    words = ["train", "ramp-pointmass", *OPTIONS.split(), "--epochs", str(epochs)]
    command = [sys.executable, "-m", "everystate", *words, "--run-dir", str(run)]
    looks = []
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            if seen := look(process.pid, run):
                looks.append(seen)
            time.sleep(1)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    elapsed = [line["time/elapsed_s"] for line in read_metrics(run)]
    times = [after - before for before, after in itertools.pairwise(elapsed)]
    return looks, times


def tenths(values: list[float]) -> list[float]:
    """The median of each tenth."""
    ends = [round(i * len(values) / 10) for i in range(11)]
    return [median(values[a:b]) for a, b in itertools.pairwise(ends)]


def main() -> None:
    """Runs, and writes both files."""
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    with tempfile.TemporaryDirectory() as folder:
        looks, times = soak(steps // PER_EPOCH, Path(folder) / "run")
    # A start loads and compiles: what it takes says nothing of what follows.
    looks = looks[len(looks) // 20 :]
    series = {name: [look[name] for look in looks] for name in ("memory_mb", "files", "threads")}
    series["epoch_s"] = times
    begun = [look for look in looks if look["epochs"]]
    series["epoch_cpu_s"] = [
        (after["cpu_s"] - before["cpu_s"]) / (after["epochs"] - before["epochs"])
        for before, after in zip(begun, begun[10:], strict=False)  # ten seconds apart
    ]
    said = {
        "options": OPTIONS,
        "environment_steps": steps,
        "minutes": round(sum(times) / 60, 1),
        "tenths": {name: [round(x, 3) for x in tenths(x)] for name, x in series.items()},
    }
    raw.write(RESULTS / "soak.json", said, replace=True)
    figure, axes = plt.subplots(1, 5, figsize=(15, 2.8), layout="constrained")
    for axis, (name, title) in zip(axes.flat, SHOWN.items(), strict=True):
        axis.plot(range(5, 105, 10), tenths(series[name]), marker="o", linewidth=2)
        axis.set(title=title, xlabel="per cent of the run", xlim=(0, 100))
        axis.set_ylim(0, 1.3 * max(series[name]))
    figure.savefig(RESULTS / "soak.png", dpi=120)
    print(json.dumps(said["tenths"]))


if __name__ == "__main__":
    main()
