"""Whether skills last: the named skills at every checkpoint that a run has kept.

    python experiments/over_training.py runs/cartpole-quick-seed0

Success rates with planning, over 100 starts, go to `results/BODY/over-training.json`, by run and
epoch, and all that is in there is drawn in `over-training.png`.
"""

import json
import sys
from pathlib import Path

import seeds

import everystate
from everystate.evaluation import provenance, success_rates
from everystate.viewing.figures import skills_over_training


def main(run: Path) -> None:
    """Evaluates the checkpoints that are not in the file yet."""
    checkpoints = sorted(run.glob("checkpoints/[0-9]*"))
    folder = seeds.results_of(everystate.load(run).config.body)
    file = folder / "over-training.json"
    found = json.loads(file.read_text()) if file.exists() else {}
    rates = found.setdefault(run.name, {"commit": provenance()["commit"], "skills": {}})["skills"]
    for checkpoint in checkpoints:
        epoch = str(int(checkpoint.name))
        if epoch not in rates:
            rates[epoch] = success_rates(everystate.load(checkpoint), plan=True)
            file.write_text(json.dumps(found, indent=1) + "\n")
            print(epoch, rates[epoch], flush=True)
    skills_over_training({name: one["skills"] for name, one in found.items()}).savefig(
        file.with_suffix(".png"), dpi=150
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
