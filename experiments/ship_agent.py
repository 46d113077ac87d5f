"""Puts a trained agent into the package, with its scores and the command that made it.

    python experiments/ship_agent.py runs/experiments/ramp-pointmass/quick-seed0 ramp-pointmass

The agent goes to `src/everystate/agents/NAME`, where `everystate.load(NAME)` finds it. A new agent
takes the place of an old one only when the old folder was removed.
"""

import argparse
import json
from pathlib import Path

import everystate
from everystate import evaluation
from everystate.skills import SKILLS

AGENTS = Path(__file__).resolve().parent.parent / "src" / "everystate" / "agents"


def main() -> None:
    """Evaluates the run and exports its agent."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("name")
    parser.add_argument("--evaluation", type=Path, help="a result of `evaluate --skills --json`")
    options = parser.parse_args()
    agent = everystate.load(options.run)
    if options.evaluation:
        result = json.loads(options.evaluation.read_text())
    else:
        result = evaluation.evaluate(options.run, skills=agent.config.body in SKILLS)
    config = json.loads((options.run / "config.json").read_text())
    scores = {
        "command": f"everystate train {agent.config.body} --seed {agent.config.seed}",
        "trained_with": config.get("versions", {}),
        "score": result["score"],
        "suites": {name: one["policy"]["score"] for name, one in result["suites"].items()},
        "skills": result["skills"],
    }
    print(agent.export(AGENTS / options.name, scores))


if __name__ == "__main__":
    main()
