"""Does the default mind how a body is observed?

    python experiments/invariance.py [--out RUNS]

The cartpole with a component rescaled, shifted or repeated, with a constant, a number for each copy
or noise like that of contacts beside its own, and with half its control step: preset `quick`, as
`invariance.toml` has it; the bodies are in `altered.py`. Every agent is sent to the goals of the
cartpole's own suites, which it sees as it sees its states. Runs are made in runs/invariance; of
each that is over results/invariance/NAME-SEED.json says how it did. What is there is left.
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import altered
import numpy as np
import seeds
from jaxtyping import Float

import everystate
from everystate import Agent
from everystate.agent.json_files import read_json
from everystate.config import Config
from everystate.envs import Cartpole
from everystate.evaluation import raw, suites
from everystate.evaluation.measure import measure
from everystate.studies import Study
from everystate.studies.runs import finished

RESULTS = seeds.RESULTS / "invariance"
BODY, OWN_STEP = "cartpole", Cartpole().frame_skip


@dataclass(frozen=True)
class Through:
    """An agent of an altered cartpole, as one of the cartpole."""

    agent: Agent
    body: altered.Altered

    @property
    def config(self) -> Config:
        """With the cartpole as its body."""
        return replace(self.agent.config, body=BODY)

    def act(self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0) -> np.ndarray:
        """What it does where it sees both in its own way."""
        return self.agent.act(*self._seen(observation, goal), plan=plan, seed=seed)

    def steps_to_goal(self, observation: Any, goal: Any) -> Any:
        """What it says there."""
        return self.agent.steps_to_goal(*self._seen(observation, goal))

    def _seen(self, *states: Float[np.ndarray, "n 5"]) -> tuple[Float[np.ndarray, "n _"], ...]:
        return tuple(self.body.altered(each) for each in states)


def measured(run: Path) -> dict[str, Any]:
    """How an agent does on the suites, in as many seconds as any other."""
    agent = everystate.load(run)
    kind = getattr(altered, agent.config.body.partition(":")[2])
    options = everystate.envs.parse_options(agent.config.body_options)
    body = kind(**options)
    found: dict[str, Any] = {}
    for name in suites.names(BODY, ()):
        suite = suites.load(BODY, name, (), "report")
        suite = replace(suite, horizons=suite.horizons * OWN_STEP // body.frame_skip)
        found[name] = measure(Through(agent, body), suite, plan=False)
    weights = np.asarray(agent.models.dynamics.weights).tolist()
    return {"suites": found, "weights": dict(zip(agent.state_names, weights, strict=True))}


def keep(study: Study, out: Path) -> None:
    """Writes what is missing of the runs that are over."""
    for name, one in study.conditions.items():
        for seed in one.seeds:
            folder, path = out / name / f"seed{seed}", RESULTS / f"{name}-{seed}.json"
            if not finished(folder) or path.exists():
                continue
            trained = {"condition": name, **read_json(folder / "config.json")}
            raw.write(path, measured(folder / "run") | {"trained": trained})
            print(path)


if __name__ == "__main__":
    # The bodies must be found wherever runs are made.
    here, known = str(Path(__file__).resolve().parent), os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([here, known] if known else [here])
    out = seeds.ROOT / "runs" / "invariance"
    seeds.main("invariance", keep, description=str(__doc__), out=out)
