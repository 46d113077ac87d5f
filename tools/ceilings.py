"""What search through MuJoCo itself reaches: python tools/ceilings.py BODY SUITE.

Beside a suite this says how much of it can be had by whoever knows the physics and is given a
budget: for each task 500 tries (cross-entropy method, 10 rounds of 50) of a whole sequence of
actions from its start, the best of which is played and scored as any agent is. It writes
results/suites/BODY-SUITE-search.json. The body must be without noise of its own.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from everystate import evaluation
from everystate.envs import Physics, make
from everystate.evaluation import metrics, raw, suites
from everystate.evaluation.suite import Suite
from everystate.presets import preset

ROUNDS, TRIES, BEST = 10, 50, 8
SMOOTH = 0.6
"""How much of a step's deviation is that of the step before: actions that last get somewhere."""
KEPT = 0.1
"""Least standard deviation of actions, so that a search never stops looking."""
RESULTS = Path(__file__).resolve().parent.parent / "results" / "suites"
Plans = Float[np.ndarray, "tasks steps action"]


class Played:
    """Plays sequences of actions, one for each task, whatever it sees."""

    def __init__(self, suite: Suite, plans: list[Float[np.ndarray, "steps action"]]) -> None:
        self.config, self.plans, self.step = preset("test", suite.body), plans, 0

    def act(self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0) -> np.ndarray:
        """The next action of each sequence, and none after its last."""
        idle, step = np.zeros_like(self.plans[0][0]), self.step
        self.step += 1
        return np.stack([plan[step] if step < len(plan) else idle for plan in self.plans])

    def steps_to_goal(self, observation: Any, goal: Any) -> Float[np.ndarray, " tasks"]:
        """It has no idea."""
        return np.full(len(observation), np.nan)


def search(suite: Suite, rng: np.random.Generator) -> Plans:
    """The best sequence found for each task; all tasks have the same horizon."""
    tasks, horizon = len(suite.goals), int(suite.horizons[0])
    assert suite.starts is not None
    starts = [start for start in suite.starts for _ in range(TRIES)]
    env = make(suite.body, len(starts), 0)
    mean: Plans = np.zeros((tasks, horizon, *env.single_action_space.shape))
    spread, best, least = np.full_like(mean, 0.8), mean.copy(), np.full(tasks, np.inf)
    for _ in range(ROUNDS):
        noise = rng.normal(0, 1, (TRIES, *mean.shape))
        for step in range(1, horizon):
            noise[:, :, step] *= np.sqrt(1 - SMOOTH**2)
            noise[:, :, step] += SMOOTH * noise[:, :, step - 1]
        tried = np.clip(mean + spread * noise, -1, 1)
        tried[0] = best
        costs = cost(env, suite, starts, tried.swapaxes(0, 1))
        order = np.argsort(costs, axis=1)[:, :BEST]
        elite = np.take_along_axis(tried.swapaxes(0, 1), order[:, :, None, None], axis=1)
        mean, spread = elite.mean(axis=1), np.maximum(elite.std(axis=1), KEPT)
        better = costs.min(axis=1) < least
        best[better], least[better] = elite[better, 0], costs.min(axis=1)[better]
    return best


def cost(
    env: Any,
    suite: Suite,
    starts: list[Physics],
    tried: Float[np.ndarray, "tasks tries steps action"],
) -> Float[np.ndarray, "tasks tries"]:
    """rms distance in sigma: the least of all steps for a motion, else that of the last ten."""
    tasks, tries, steps, size = tried.shape
    env.set_physics(starts)
    goals, weights = (np.repeat(x, tries, axis=0) for x in (suite.goals, suite.weights))
    taken = []
    for step in range(steps):
        states = env.step(tried[:, :, step].reshape(-1, size))[0]
        apart = metrics.differences(env.scored(states)[None], env.scored(goals), suite.sigma)
        taken.append(metrics.rms(apart, weights)[0])
    distance = np.stack(taken)
    passed = suite.scored_by[1] == "hit"
    told = distance.min(axis=0) if passed else distance[-10:].mean(axis=0)
    return told.reshape(tasks, tries)


def main() -> None:
    """Searches, plays what was found, and writes how it did."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("body")
    parser.add_argument("suite")
    parser.add_argument("--tasks", type=int, help="only so many, evenly taken")
    options = parser.parse_args()
    suite = suites.load(options.body, options.suite)
    suite = suite.subset(options.tasks) if options.tasks else suite
    plans: list[Any] = [None] * len(suite.goals)
    for horizon in np.unique(suite.horizons):
        chosen = np.flatnonzero(suite.horizons == horizon)
        found = search(suite.only(chosen), np.random.default_rng(int(horizon)))
        for task, plan in zip(chosen, found, strict=True):
            plans[task] = plan
        print(f"horizon {horizon}: {len(chosen)} tasks searched", flush=True)
    result = {
        "body": suite.body,
        "agent": "search through MuJoCo",
        "budget": {"tries": ROUNDS * TRIES, "rounds": ROUNDS, "best": BEST},
        "suites": {suite.name: evaluation.described(suite)},
    }
    result["suites"][suite.name]["policy"] = evaluation.measure(
        Played(suite, plans), suite, plan=False
    )
    path = RESULTS / f"{suite.body}-{suite.name}-search.json"
    raw.write(path, result)
    print(path, result["suites"][suite.name]["policy"]["score"])


if __name__ == "__main__":
    main()
