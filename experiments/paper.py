"""The paper's own settings at the paper's own sizes: python experiments/paper.py [--out RUNS].

Makes the runs of `paper.toml` in runs/paper, in an hour or more each on one core. Of every run that
is over, whole or broken down, it writes results/paper/NAME-SEED.json: how its last agent does on
the body's suites and skills, some columns of its metrics, and what ended it. What is there already
is left.
"""

from pathlib import Path
from typing import Any

import seeds

from everystate import evaluation
from everystate.agent.json_files import read_json
from everystate.evaluation import raw
from everystate.skills import SKILLS
from everystate.studies import Study
from everystate.studies.runs import MEASURED, finished

RESULTS = seeds.RESULTS / "paper"
_KEPT = ("epoch", "steps", "episode/length", "episode/reached", "value/", "coverage/", "replay/ess")
_KEPT += ("env/falls", "eval/success", "eval/rest/score", "eval/motion/score")


def measured(folder: Path) -> dict[str, Any]:
    """All that is said of a run."""
    run = folder / "run"
    lines, config = seeds.lines_of(run), read_json(run / "config.json")
    found: dict[str, Any] = {}
    if finished(folder):
        found = read_json(folder / MEASURED)
    elif any((run / "checkpoints").glob("[0-9]*")):
        found = evaluation.evaluate(run, skills=config["config"]["body"] in SKILLS)
    return {
        **found,
        "trained": {"condition": folder.parent.name, **config},
        "epochs": lines[-1]["epoch"] if lines else 0,
        "broke_in_epoch": seeds.broke_down(run),
        "curves": seeds.curves(lines, _KEPT),
    }


def keep(study: Study, out: Path) -> None:
    """Writes what is missing of the runs that are over."""
    for name, one in study.conditions.items():
        for seed in one.seeds:
            folder, path = out / name / f"seed{seed}", RESULTS / f"{name}-{seed}.json"
            stops = one.config(seed).not_finite == "stop"
            over = finished(folder) or (stops and seeds.broke_down(folder / "run"))
            if over and not path.exists():
                raw.write(path, measured(folder))
                print(path)


if __name__ == "__main__":
    seeds.main("paper", keep, description=str(__doc__), out=seeds.ROOT / "runs" / "paper")
