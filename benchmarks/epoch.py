"""Where a whole epoch's time goes: `python benchmarks/epoch.py [--json] [--body NAME]`.

Trains at preset `quick` and reads the run's own clock. Shares of everything after the first epoch,
which compiles: the learner's updates, collection (bodies, actions, goals, the replay), and the rest
(checks, coverage, logging, and a checkpoint every ten epochs).
"""

import tempfile
from pathlib import Path
from typing import Any

import _benchmark as benchmark

import everystate

EPOCHS = 21


def profile(body: str) -> dict[str, Any]:
    """Seconds per epoch, and what they are spent on."""
    epochs: list[Any] = []
    with tempfile.TemporaryDirectory() as name:
        everystate.train(
            body, run_dir=Path(name) / "run", progress=False, on_epoch=epochs.append, epochs=EPOCHS
        )
    # An epoch's line is written before its checkpoint, so the last one's falls outside.
    whole = epochs[-1]["time/elapsed_s"] - epochs[0]["time/elapsed_s"]
    of = {n: sum(e[f"time/{n}_s"] for e in epochs[1:]) for n in ("update", "collect")}
    return {
        "epoch_s": whole / (EPOCHS - 1),
        "fraction_learner": of["update"] / whole,
        "fraction_collection": of["collect"] / whole,
        "fraction_rest": 1 - sum(of.values()) / whole,
    }


def main() -> None:
    """Measures and prints."""
    options = benchmark.options(__doc__, body="ant").parse_args()
    result = {
        "benchmark": "epoch",
        "body": options.body,
        "preset": "quick",
        **profile(options.body),
        "machine": benchmark.machine(),
    }
    benchmark.show(result, as_json=options.json, out=options.out)


if __name__ == "__main__":
    main()
