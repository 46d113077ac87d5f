"""An agent on its way, in a few pictures."""

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from everystate.envs import BodyVectorEnv, make, parse_options
from everystate.envs.rendering import Along
from everystate.errors import EverystateError
from everystate.evaluation import Agent, apart_from, metrics, rollout, suites
from everystate.viewing import plots

FRAMES = 6


def filmstrip(agent: Agent, env: BodyVectorEnv, suite: suites.Suite, *, planning: bool) -> Figure:
    """The way from the suite's first kind of place to a goal of its last: on the ramp, a climb.

    Of the tasks that the policy, or else `planning`, still holds at the end it is the one of median
    duration; where there is none, the first one, and the titles say so.
    """
    if suite.starts is None or not env.placeable:
        raise EverystateError(f"{env.name} cannot be drawn from what it observes, only live")
    plan = False
    states, came = attempts(agent, suite, plan=plan)
    kinds = np.array(suite.kinds)
    chosen = (kinds == kinds[-1]) & (env.regions(states[0]) == kinds[0])
    chosen = chosen if chosen.any() else kinds == kinds[-1]
    if planning and not np.isfinite(came[chosen]).any():
        plan = True
        states, came = attempts(agent, suite, plan=plan)
    reached = np.flatnonzero(chosen & np.isfinite(came))
    task, end = int(chosen.argmax()), int(suite.horizons.max())
    if reached.size:
        task = int(reached[np.argsort(came[reached])[reached.size // 2]])
        end = int(came[task])
    at = np.linspace(0, end, FRAMES).round().astype(int)
    size = {"width": 640, "height": 480}
    along = Along(states[: end + 1, task], at)
    frames = env.render_states(states[at, task], suite.goals[task], **size, along=along)
    where = env.regions(states[at, task])
    titles = [f"step {step}, {place}" for step, place in zip(at, where, strict=True)]
    titles[0] += " (planning)" if plan else " (policy)"
    titles[-1] += ": at the goal" if reached.size else ": goal not reached"
    return plots.filmstrip(list(frames), titles)


def attempts(
    agent: Agent, suite: suites.Suite, *, plan: bool
) -> tuple[Float[np.ndarray, "steps goals state"], Float[np.ndarray, " goals"]]:
    """States of all tasks of a suite, and when those held at the end were first reached, or NaN."""
    bodies = make(suite.body, len(suite.goals), 0, **parse_options(agent.config.body_options))
    begun, steps = suite.begin(bodies, 0), int(suite.horizons.max())
    states = rollout(agent, bodies, begun, suite.goals, steps, plan=plan, seed=0)
    distance = metrics.largest(apart_from(bodies, suite, states[1:]), suite.weights)
    came = metrics.first_steps(distance, suite.horizons, 0.5)
    held = metrics.readings(distance, suite.horizons, 0.5)["end"] > 0
    return states, np.where(held, came, np.nan)
