"""What runs on cartpole did and could do: python experiments/cartpole_notes.py RUN [RUN ...].

Writes, for every run folder, the share of 100 starts from which each named skill succeeded, and
where the bodies and their goals were during training (`samples/`), to
`results/cartpole-notes/summary.json`; other runs in it stay as they are. A run whose agent this
everystate cannot load has no skills there. The runs are those of `docs/lab-notes.md`, 2026-11-23.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

import everystate
from everystate.evaluation import provenance, success_rates

SUMMARY = Path(__file__).resolve().parents[1] / "results" / "cartpole-notes" / "summary.json"


def whereabouts(samples: Path) -> dict[str, float]:
    """Of one epoch: shares of the states visited, speeds in rad/s, how far goals are from any."""
    with np.load(samples) as arrays:
        states, goals = arrays["next_observations"], arrays["goals"]
    _, cosine, _, _, w = states.T
    slow = np.abs(w)
    found = {
        "mean_speed": slow.mean(),
        "slower_than_3": (slow < 3).mean(),
        "upright_and_slower_than_2": ((cosine > 0.9) & (slow < 2)).mean(),
        "goals_off_the_circle": np.abs(goals[:, 1] ** 2 + goals[:, 2] ** 2 - 1).mean(),
    }
    return {name: round(float(value), 3) for name, value in found.items()}


def skills(run: Path) -> dict[str, Any] | None:
    """Success rates by the policy and with planning; None for an agent of another version."""
    try:
        agent = everystate.load(run)
    except everystate.EverystateError as error:
        print(f"{run}: {error}", file=sys.stderr)
        return None
    return {
        "policy": success_rates(agent, plan=False),
        "planning": success_rates(agent, plan=True),
    }


def main(runs: list[str]) -> None:
    """Summarises the runs."""
    summary = json.loads(SUMMARY.read_text()) if SUMMARY.exists() else {}
    for run in map(Path, runs):
        samples = sorted((run / "samples").glob("*.npz"))
        summary[run.name] = {
            "skills": skills(run),
            "epochs": {str(int(path.stem)): whereabouts(path) for path in samples[::3]},
            "commit": provenance()["commit"],
        }
        SUMMARY.write_text(json.dumps(summary, indent=1) + "\n")
        print(run.name, summary[run.name]["skills"])


if __name__ == "__main__":
    main(sys.argv[1:])
