"""Puts a trained agent into the package, with its scores and the command that made it.

    python tools/ship_agent.py runs/experiments/ramp-pointmass/quick-seed0 ramp-pointmass

The agent goes to `src/everystate/agents/NAME`, where `everystate.load(NAME)` finds it. A new agent
takes the place of an old one only when the old folder was removed.

    python tools/ship_agent.py --renew cartpole

writes a shipped agent anew, in the format of today: the same arrays and settings, what the model of
its body compiles to today, and the scores of an `--evaluation` or else those it has. Before that,
see that the model has not changed.

An agent's scores say what drives it best (`best_by`).
"""

import argparse
import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import everystate
from everystate import envs, evaluation
from everystate.agent import ActWith
from everystate.skills import SKILLS
from everystate.training.bodies import info

AGENTS = Path(__file__).resolve().parent.parent / "src" / "everystate" / "agents"


def main() -> None:
    """Evaluates the run and exports its agent."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("run", type=Path, nargs="?")
    parser.add_argument("name")
    parser.add_argument("--renew", action="store_true", help="write the shipped agent anew")
    parser.add_argument("--evaluation", type=Path, help="a result of `evaluate --skills --out`")
    options = parser.parse_args()
    if options.renew:
        return renew(AGENTS / options.name, options.evaluation)
    if options.run is None:
        parser.error("give a RUN, or --renew")
    agent = everystate.load(options.run)
    if options.evaluation:
        result = json.loads(options.evaluation.read_text())
    else:
        result = evaluation.evaluate(options.run, skills=agent.config.body in SKILLS)
    config = json.loads((options.run / "config.json").read_text())
    scores = {
        "command": f"everystate train {agent.config.body} --seed {agent.config.seed}",
        "trained_with": config.get("versions", {}),
        **told(result),
    }
    agent = dataclasses.replace(agent, act_with=best_by(scores))
    print(agent.export(AGENTS / options.name, scores))


def told(result: dict[str, Any]) -> dict[str, Any]:
    """What an agent keeps of its evaluation."""
    suites = {name: one["policy"]["score"] for name, one in result["suites"].items()}
    return {"score": result["score"], "suites": suites, "skills": result["skills"]}


def best_by(scores: dict[str, Any]) -> ActWith:
    """Planning where it does more of the skills, by the sum of their rates; or else the policy."""
    rates = scores["skills"] or {}
    planning, policy = (sum((rates.get(way) or {}).values()) for way in ("planning", "policy"))
    return "plan" if planning > policy else "policy"


def renew(folder: Path, evaluated: Path | None) -> None:
    """Writes a shipped agent anew."""
    agent = everystate.load(folder)
    env = envs.make(agent.config.body, 1, 0, **envs.parse_options(agent.config.body_options))
    scores = json.loads((folder / "agent.json").read_text())["scores"]
    if evaluated:
        kept = {name: scores[name] for name in ("command", "trained_with")}
        scores = kept | told(json.loads(evaluated.read_text()))
    body = info(agent.config, env)
    agent = dataclasses.replace(agent, body=body, act_with=best_by(scores))
    draft = agent.export(folder.with_name(f"{folder.name}-renewed"), scores)
    shutil.rmtree(folder)
    print(draft.rename(folder))


if __name__ == "__main__":
    main()
