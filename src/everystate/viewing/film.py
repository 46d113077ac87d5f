"""An agent on its way to a goal of a suite, as a film shows it."""

import numpy as np
from jaxtyping import Float

from everystate.envs import BodyVectorEnv, make, parse_options
from everystate.errors import EverystateError
from everystate.evaluation import Agent, apart_from, metrics, rollout
from everystate.evaluation.suite import Suite
from everystate.viewing.recording import Recording

_STAYS = 1.0  # seconds that are shown of it at the goal


def journey(agent: Agent, env: BodyVectorEnv, suite: Suite, *, planning: bool) -> Recording:
    """The way from the suite's first kind of place to a goal of its last: on the ramp, a climb.

    Of the tasks that the policy, or else `planning`, still holds at the end it is the one of median
    duration; where there is none, the first one, and the title says so.
    """
    if suite.starts is None or not env.placeable:
        raise EverystateError(f"{env.name} cannot be drawn from what it observes, only live")
    plan = False
    states, distance, came = attempts(agent, suite, plan=plan)
    kinds = np.array(suite.kinds)
    chosen = (kinds == kinds[-1]) & (env.regions(states[0]) == kinds[0])
    chosen = chosen if chosen.any() else kinds == kinds[-1]
    if planning and not np.isfinite(came[chosen]).any():
        plan = True
        states, distance, came = attempts(agent, suite, plan=plan)
    reached = np.flatnonzero(chosen & np.isfinite(came))
    task, end = int(chosen.argmax()), int(suite.horizons.max())
    if reached.size:
        task = int(reached[np.argsort(came[reached])[reached.size // 2]])
        end = min(end, int(came[task]) + round(_STAYS / (env.control_step or 0.04)))
    way = states[: end + 1, task].astype(np.float32)
    goals = np.broadcast_to(suite.goals[task].astype(np.float32), way.shape)
    title = "with planning" if plan else "by the policy"
    title += "" if reached.size else "; the goal was not reached"
    steps = np.asarray(agent.steps_to_goal(way, goals))
    return Recording(title, way, goals, steps, distance[: end + 1, task])


def attempts(
    agent: Agent, suite: Suite, *, plan: bool
) -> tuple[
    Float[np.ndarray, "steps goals state"],
    Float[np.ndarray, "steps goals"],
    Float[np.ndarray, " goals"],
]:
    """States of all tasks of a suite, and how far they are from their goals in σ.

    And when the goals that were held at the end were first reached, or NaN.
    """
    bodies = make(suite.body, len(suite.goals), 0, **parse_options(agent.config.body_options))
    begun, steps = suite.begin(bodies, 0), int(suite.horizons.max())
    states = rollout(agent, bodies, begun, suite.goals, steps, plan=plan, seed=0)
    distance = metrics.largest(apart_from(bodies, suite, states), suite.weights)
    came = metrics.first_steps(distance[1:], suite.horizons, 0.5)
    held = metrics.readings(distance[1:], suite.horizons, 0.5)["end"] > 0
    return states, distance, np.where(held, came, np.nan)
