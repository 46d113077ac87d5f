"""Sends an agent to every goal of a suite, all at once, and measures how that went."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from everystate.agent import step_seed
from everystate.envs import BodyVectorEnv, make, parse_options
from everystate.evaluation import metrics
from everystate.evaluation.agents import Agent, warn_of_another_model
from everystate.evaluation.suite import Suite

_DECIMALS = 4  # of distances kept per task, in units of sigma


def measure(
    agent: Agent,
    suite: Suite,
    *,
    plan: bool,
    seed: int = 0,
    world: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """How an agent does on a suite, by its policy or by planning, as JSON can hold it.

    Args:
        agent: whose `act` decides.
        suite: the tasks.
        plan: whether the agent plans at act time.
        seed: of the body's noise and of planning.
        world: options of the body that make it another than the agent's own.

    Returns:
        What `score_states` returns.
    """
    options = parse_options(agent.config.body_options) | dict(world or {})
    env = make(suite.body, len(suite.goals), seed, **options)
    warn_of_another_model(agent, env)
    begun, steps = suite.begin(env, seed), int(suite.horizons.max())
    goals = suite.asked(env.state_names)
    states = rollout(agent, env, begun, goals, steps, plan=plan, seed=seed)
    predicted = np.asarray(agent.steps_to_goal(begun, goals))
    return score_states(env, suite, states, predicted)


def score_states(
    env: BodyVectorEnv,
    suite: Suite,
    states: Float[np.ndarray, "steps tasks state"],
    predicted: Float[np.ndarray, " tasks"],
) -> dict[str, Any]:
    """What is told of the way to every goal of a suite, whoever went it, as JSON can hold it.

    Args:
        env: any number of the suite's body.
        suite: the tasks.
        states: observations of each task's body, the start first; what lies beyond a task's horizon
            does not count, but must be there up to the longest.
        predicted: steps from each start to its goal, or NaN.

    Returns:
        `score` by group, which `Suite.scored_by` explains; `success` as
        `[measure][group][eps][reading]`, measures, eps and readings being those of `metrics`,
        groups those of the suite; `position_only` as one measure's part of it, the largest over
        positions alone; `closest` as in `metrics.medians`; `falls_per_1000_steps` by group;
        `calibration` of the predicted steps; and `tasks`, lists with a number for each task: the
        distance at the nearest step and at the last one by each measure, from which success can be
        told anew.
    """
    apart = apart_from(env, suite, states[1:])
    horizons, groups, weights = suite.horizons, suite.groups, suite.weights
    position = suite.mask(suite.position)
    distances = {"max": metrics.largest(apart, weights), "rms": metrics.rms(apart, weights)}
    found = metrics.approach(apart, weights, suite.mask(suite.velocity), horizons)
    falls = env.falls(states[:-1], states[1:])
    came = metrics.first_steps(distances["max"], horizons, metrics.EPS[0])
    success = {name: metrics.success(d, horizons, groups) for name, d in distances.items()}
    chief, reading = suite.scored_by
    return {
        "score": {name: found["0.5"][reading] for name, found in success[chief].items()},
        "success": success,
        "position_only": metrics.success(
            metrics.largest(apart, weights * position), horizons, groups
        ),
        "closest": metrics.medians(found, groups),
        "falls_per_1000_steps": {
            name: metrics.rate(falls[:, chosen], horizons[chosen])
            for name, chosen in groups.items()
        },
        "calibration": metrics.calibration(predicted, came),
        "tasks": _by_task(distances, suite),
    }


def rollout(
    agent: Agent,
    env: BodyVectorEnv,
    observations: Float[np.ndarray, "envs state"],
    goals: Float[np.ndarray, "envs state"],
    steps: int,
    *,
    plan: bool,
    seed: int,
) -> Float[np.ndarray, "_ envs state"]:
    """States [steps + 1, envs, state] of bodies sent to goals from where they are.

    `observations` are what the bodies observe there; no episode rule ends the way. NaN in a goal is
    what is not asked.
    """
    goals = np.asarray(goals, dtype=np.float32)
    states = [observations]
    for step in range(steps):
        actions = agent.act(observations, goals, plan=plan, seed=step_seed(seed, step))
        observations, _, _, _, info = env.step(actions)
        states.append(info.get("final_obs", observations))
    return np.stack(states)


def apart_from(
    env: BodyVectorEnv, suite: Suite, states: Float[np.ndarray, "steps tasks state"]
) -> Float[np.ndarray, "steps tasks scored"]:
    """How far states are from the suite's goals, by component, in units of sigma."""
    scored, goals = env.scored(states), env.scored(suite.goals)
    return metrics.differences(scored, goals, suite.sigma, suite.mask(suite.angular))


def _by_task(distances: Mapping[str, metrics.Distance], suite: Suite) -> dict[str, Any]:
    """The least distance and the last one of each task."""
    last = suite.horizons - 1, np.arange(len(suite.horizons))
    lists = {}
    for name, distance in distances.items():
        counted = np.where(metrics.within(suite.horizons, len(distance)), distance, np.inf)
        for reading, values in (("nearest", counted.min(axis=0)), ("end", distance[last])):
            lists[f"{name}_{reading}"] = values.round(_DECIMALS).tolist()
    return lists
