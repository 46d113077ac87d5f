"""The paper's own settings at the paper's own sizes: python experiments/paper.py [--runs RUNS].

Makes no run: `everystate train` does, by the options in `TRAINED` and `--evaluation-period 10
--run-dir RUNS/NAME`, in an hour or more each on one core, resumable. Of every run there is, whole
or broken down, it writes results/paper/NAME.json: how its last agent does on the body's suites and
skills, some columns of its metrics, and what ended it. What is there already is left.
"""

import json
from pathlib import Path
from typing import Any

from made_runs import curves, write_missing

from everystate import evaluation
from everystate.agent.files import read_lines
from everystate.skills import SKILLS

RESULTS = Path(__file__).resolve().parent.parent / "results" / "paper"
TRAINED = {
    f"{name}-{seed}": (*options, "--seed", str(seed))
    for name, seeds, options in (
        ("paper-ramp", 3, ("ramp-pointmass", "--preset", "paper")),
        # Figure 3's two ablations.
        ("mean-ramp", 3, ("ramp-pointmass", "--preset", "paper", "--pessimism", "mean")),
        ("density-ramp", 3, ("ramp-pointmass", "--preset", "paper", "--m", "1")),
        ("paper-cartpole", 1, ("cartpole", "--preset", "paper")),
        ("literal-ramp", 1, ("ramp-pointmass", "--preset", "literal")),
        ("literal-cartpole", 1, ("cartpole", "--preset", "literal")),
    )
    for seed in range(seeds)
}
"""Options of `everystate train`, by the name of the run."""
_KEPT = ("epoch", "steps", "episode/length", "episode/reached", "value/", "coverage/", "replay/ess")
_KEPT += ("env/falls", "eval/success", "eval/rest/score", "eval/motion/score")


def measured(run: Path) -> dict[str, Any]:
    """All that is said of a run."""
    lines = read_lines(run / "metrics.jsonl")
    faults = sorted((run / "faults").glob("*"))
    config = json.loads((run / "config.json").read_text())
    found: dict[str, Any] = {}
    if any((run / "checkpoints").glob("[0-9]*")):
        found = evaluation.evaluate(run, skills=config["config"]["body"] in SKILLS)
    return {
        **found,
        "trained": {"options": list(TRAINED[run.name]), **config},
        "epochs": lines[-1]["epoch"] if lines else 0,
        "broke_in_epoch": int(faults[0].name) if faults else None,
        "curves": curves(lines, _KEPT),
    }


if __name__ == "__main__":
    write_missing(str(__doc__), TRAINED, RESULTS, measured)
