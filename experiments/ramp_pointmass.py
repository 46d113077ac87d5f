"""Trains and evaluates several seeds on the Ramp Pointmass; keeps the raw results and a figure.

    python experiments/ramp_pointmass.py

Runs go to `runs/experiments/ramp-pointmass/SETTING-seedN` and resume when the command is given
again. What the figures need of them is copied to `results/ramp-pointmass/SETTING/seedN`:
`config.json`, `metrics.jsonl` and `evaluation.json`; medians and intervals over seeds are in
`results/ramp-pointmass/summary.json`. Each run has one core to itself.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue

HERE = Path(__file__).resolve().parent.parent
RUNS = HERE / "runs" / "experiments" / "ramp-pointmass"
RESULTS = HERE / "results" / "ramp-pointmass"

# `literal` at the sizes of `quick`, as its own would take a day: it lacks the stabilisers, and what
# else `quick` adds to the paper (docs/algorithm.md, section 4).
_SIZES = (
    "--batch-size 256 --N 8 --width 128 --depth 3 --state-layers 6 --curriculum-layers 6"
    " --capacity 100000 --epochs 60"
)
SETTINGS: dict[str, tuple[str, int]] = {
    "quick": ("--preset quick", 5),
    "literal": (f"--preset literal {_SIZES}", 3),
}


def run(setting: str, seed: int, core: int, extra: list[str]) -> None:
    """One seed: train (or go on), evaluate, copy what is worth keeping."""
    folder, kept = RUNS / f"{setting}-seed{seed}", RESULTS / setting / f"seed{seed}"
    everystate = [sys.executable, "-m", "everystate"]
    options = [*SETTINGS[setting][0].split(), "--seed", str(seed), *extra]
    folder.parent.mkdir(parents=True, exist_ok=True)
    kept.mkdir(parents=True, exist_ok=True)

    def call(*words: str) -> str:
        done = subprocess.run(
            [*everystate, *words],
            stdout=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: os.sched_setaffinity(0, {core}),
        )
        if done.returncode:
            print(f"{setting} seed {seed}: `{' '.join(words)}` ended with {done.returncode}")
        return done.stdout

    words = ["train", "ramp-pointmass", *options, "--evaluation-period", "20", "--quiet"]
    call(*words, "--run-dir", str(folder.relative_to(HERE)))
    result = call("evaluate", str(folder.relative_to(HERE)), "--json").splitlines()
    if result:
        (kept / "evaluation.json").write_text(json.dumps(json.loads(result[-1]), indent=1) + "\n")
    for name in ("config.json", "metrics.jsonl"):
        shutil.copy(folder / name, kept / name)
    print(f"{setting} seed {seed}: in {kept.relative_to(HERE)}", flush=True)


def summarise() -> None:
    """Writes summary.json and the figure from what is in the results folder."""
    from everystate.evaluation.aggregate import over_seeds
    from everystate.viewing.figures import comparison

    folders = {name: sorted((RESULTS / name).glob("seed*")) for name in SETTINGS}
    folders = {name: found for name, found in folders.items() if found}
    summaries = {}
    for name, found in folders.items():
        files = [folder / "evaluation.json" for folder in found]
        results = [json.loads(file.read_text()) for file in files if file.exists()]
        if results:
            summaries[name] = over_seeds(results)
    (RESULTS / "summary.json").write_text(json.dumps(summaries, indent=1) + "\n")
    comparison(folders, over="epoch").savefig(RESULTS / "literal-against-quick.png", dpi=150)


def main() -> None:
    """Every setting and seed asked for, two at a time, then the summary."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--settings", nargs="+", default=list(SETTINGS), choices=SETTINGS)
    parser.add_argument("--seeds", nargs="+", type=int, help="instead of all of each setting")
    parser.add_argument("--summary-only", action="store_true")
    options, extra = parser.parse_known_args()
    if not options.summary_only:
        cores: Queue[int] = Queue()
        for core in sorted(os.sched_getaffinity(0)):
            cores.put(core)

        def job(setting: str, seed: int) -> None:
            core = cores.get()
            try:
                run(setting, seed, core, extra)
            finally:
                cores.put(core)

        with ThreadPoolExecutor(cores.qsize()) as pool:
            waiting = [
                pool.submit(job, setting, seed)
                for setting in options.settings
                for seed in options.seeds or range(SETTINGS[setting][1])
            ]
            for future in waiting:
                future.result()
    summarise()


if __name__ == "__main__":
    main()
