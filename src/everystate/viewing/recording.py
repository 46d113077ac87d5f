"""What an agent did on its way somewhere, and what it thought of it: the raw material of films."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from everystate.agent import Agent, step_seed
from everystate.envs import BodyVectorEnv, make, parse_options
from everystate.errors import EverystateError
from everystate.evaluation import perform, warn_of_another_model
from everystate.goals import Goal
from everystate.skills import skill as skill_of
from everystate.viewing.pursuit import distance

EXPLORED = 5
"""How many proposed goals `explore` goes to."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One body on its way, a row per control step, in the body's own units."""

    title: str
    states: Float32[np.ndarray, "steps state"]
    goals: Float32[np.ndarray, "steps state"]
    steps_to_goal: Float[np.ndarray, " steps"]
    """What the agent thought: -V(s, g)."""
    distance: Float[np.ndarray, " steps"]
    """In σ; see `pursuit.distance`."""


def body_of(agent: Agent, seed: int = 0) -> BodyVectorEnv:
    """One body like the one the agent was trained on.

    Raises:
        EverystateError: it can be drawn only live, not from what it observed.
    """
    config = agent.config
    env = make(config.body, 1, seed, **parse_options(config.body_options))
    warn_of_another_model(agent, env)
    if not env.placeable:
        raise EverystateError(f"{env.name} cannot be drawn from what it observed, only live")
    return env


def record_skill(agent: Agent, name: str, *, plan: bool, seed: int) -> Recording:
    """A named skill, from one of its starts."""
    one = skill_of(agent.config.body, name)
    states, done = perform(agent, one, plan=plan, seed=seed, starts=1)
    asked = [one.goal(min(step, one.steps - 1)) for step in range(len(states))]
    goals = np.stack([agent.complete(*pair) for pair in zip(states[:, 0], asked, strict=True)])
    how = "with planning" if plan else "by the policy"
    return _recording(
        agent, f"{name}, {how}: {'done' if done[0] else 'not done'}", states[:, 0], goals
    )


def record_goal(agent: Agent, goal: Goal, *, steps: int, plan: bool, seed: int) -> Recording:
    """From where the body begins to one goal, whole or in part, which it then tries to keep."""
    states, goals = _sent(agent, [goal] * steps, plan=plan, seed=seed)
    return _recording(agent, "to a goal", states, goals, goal)


def record_exploration(agent: Agent, *, steps: int, plan: bool, seed: int) -> Recording:
    """As in training: to goals that the agent proposes, each for an equal share of the steps."""
    proposed = agent.propose_goals(EXPLORED, seed)
    goals = list(proposed[np.arange(steps) * EXPLORED // steps])
    return _recording(agent, "to goals of its own", *_sent(agent, goals, plan=plan, seed=seed))


def _sent(
    agent: Agent, goals: Sequence[Goal], *, plan: bool, seed: int
) -> tuple[Float32[np.ndarray, "_ state"], Float32[np.ndarray, "_ state"]]:
    """States, and the whole goals that the agent made of each goal in them."""
    env = body_of(agent, seed)
    observations, _ = env.reset(seed=seed)
    states, whole = [observations], []
    for step, goal in enumerate(goals):
        whole.append(agent.complete(states[-1], goal))
        actions = agent.act(states[-1], whole[-1], plan=plan, seed=step_seed(seed, step))
        states.append(env.step(actions)[0])
    return np.concatenate(states), np.concatenate([*whole, whole[-1]])


def _recording(
    agent: Agent,
    title: str,
    states: Float32[np.ndarray, "steps state"],
    goals: Float[np.ndarray, "steps state"],
    asked: Goal | None = None,
) -> Recording:
    goals = goals.astype(np.float32)
    return Recording(
        title,
        states,
        goals,
        np.asarray(agent.steps_to_goal(states, goals)),
        distance(agent, states, goals if asked is None else asked),
    )
