"""An agent on its way, in a few pictures."""

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from everystate.envs import BodyVectorEnv, make, parse_options
from everystate.errors import EverystateError
from everystate.evaluation import Agent, metrics, rollout, suites
from everystate.viewing import plots

FRAMES = 6


def filmstrip(agent: Agent, env: BodyVectorEnv, suite: suites.Suite, *, planning: bool) -> Figure:
    """The way from the suite's first region to a goal in its last: on the ramp, a climb.

    Of the tasks that the policy, or else `planning`, still holds at the end it is the one of median
    duration; where there is none, the first one, and the titles say so.
    """
    if suite.starts is None:
        raise EverystateError(f"{env.name} cannot be drawn from what it observes, only live")
    regions = env.regions(suite.goals)
    chosen = (regions == regions[-1]) & (env.regions(suite.starts) == regions[0])
    plan = False
    states, came = attempts(agent, env, suite, plan=plan)
    if planning and not np.isfinite(came[chosen]).any():
        plan = True
        states, came = attempts(agent, env, suite, plan=plan)
    reached = np.flatnonzero(chosen & np.isfinite(came))
    task, end = int(chosen.argmax()), int(suite.horizons.max())
    if reached.size:
        task = int(reached[np.argsort(came[reached])[reached.size // 2]])
        end = int(came[task])
    at = np.linspace(0, end, FRAMES).round().astype(int)
    frames = env.render_states(states[at, task], suite.goals[task], width=640, height=480)
    where = env.regions(states[at, task])
    titles = [f"step {step}, {place}" for step, place in zip(at, where, strict=True)]
    titles[0] += " (planning)" if plan else " (policy)"
    titles[-1] += ": at the goal" if reached.size else ": goal not reached"
    return plots.filmstrip(list(frames), titles)


def attempts(
    agent: Agent, env: BodyVectorEnv, suite: suites.Suite, *, plan: bool
) -> tuple[Float[np.ndarray, "steps goals state"], Float[np.ndarray, " goals"]]:
    """States of all tasks of a suite, and when those held at the end were first reached, or NaN."""
    options, steps = parse_options(agent.config.body_options), int(suite.horizons.max())
    bodies = make(suite.body, len(suite.goals), 0, **options)
    states = rollout(agent, bodies, suite.starts, suite.goals, steps, plan=plan, seed=0)
    distance = metrics.distances(
        env.scored(states[1:]), env.scored(suite.goals), suite.sigma, suite.mask(suite.angular)
    )
    came = metrics.first_steps(distance, suite.horizons, 0.5)
    held = metrics.readings(distance, suite.horizons, 0.5)["last"] > 0
    return states, np.where(held, came, np.nan)
