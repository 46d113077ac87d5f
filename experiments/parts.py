"""How well parts of states are reached: python experiments/parts.py [--runs RUNS].

Of the runs that `one_set.py` made, the first of each body that has suites of parts: on these,
beside random actions and doing nothing. Writes results/parts/NAME-SEED.json; what is there is left.
"""

import argparse
from pathlib import Path

import seeds

from everystate import evaluation, load
from everystate.evaluation import raw, suites
from everystate.evaluation.references import references

RESULTS = seeds.RESULTS / "parts"
BODIES = ("ramp-pointmass", "cartpole", "ant")


def measure(run: Path, path: Path) -> None:
    """Writes the result of a run."""
    agent = load(run)
    wanted = [name for name in suites.every(agent.config.body) if name.startswith("parts")]
    result = evaluation.evaluate(run, suite=wanted)
    for name, readings in references(result, agent.config).items():
        result["suites"][name]["references"] = readings
    raw.write(path, result)
    print(path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--runs", type=Path, default=seeds.ROOT / "runs" / "one-set")
    options = parser.parse_args()
    for body in BODIES:
        run, path = options.runs / body / "seed0" / "run", RESULTS / f"{body}-0.json"
        if run.exists() and not path.exists():
            measure(run, path)
