"""How often an agent performs the named skills of its body."""

import numpy as np
from jaxtyping import Bool, Float32

from everystate.agent import Performance
from everystate.envs import make, parse_options
from everystate.evaluation.agents import Agent, warn_of_another_model
from everystate.skills import Skill, skills_of

STARTS, OF_PARTS = 100, 20
"""Starts of a skill; fewer where it asks for parts, as an action takes thirty times as long."""


def success_rates(agent: Agent, *, plan: bool, seed: int = 0) -> dict[str, float]:
    """The share of starts from which each skill succeeded: see `successes`."""
    done = successes(agent, plan=plan, seed=seed)
    return {name: float(each.mean()) for name, each in done.items()}


def successes(agent: Agent, *, plan: bool, seed: int = 0) -> dict[str, Bool[np.ndarray, " _"]]:
    """From which starts each skill succeeded; a seed has the same starts for every agent."""
    return {
        name: perform(agent, one, plan=plan, seed=seed, starts=STARTS if one.whole else OF_PARTS)[1]
        for name, one in known_to(agent).items()
    }


def known_to(agent: Agent) -> dict[str, Skill]:
    """The skills of its body, but for those that ask for parts if it knows whole states only."""
    completes = hasattr(agent, "complete")
    return {n: one for n, one in skills_of(agent.config.body).items() if one.whole or completes}


def perform(
    agent: Agent, one: Skill, *, plan: bool, seed: int = 0, starts: int = STARTS
) -> tuple[Float32[np.ndarray, "steps starts state"], Bool[np.ndarray, " starts"]]:
    """States recorded while a skill was performed, from all starts at once, and which succeeded."""
    config = agent.config
    env = make(config.body, starts, seed, **parse_options(config.body_options))
    warn_of_another_model(agent, env)
    observations = one.starts(np.random.default_rng(seed), starts).astype(np.float32)
    env.set_observations(observations)
    performance, states = Performance(agent, one, plan, seed), [observations]
    while not performance.over:
        states.append(env.step(performance(states[-1]))[0])
    recorded = np.stack(states)
    done = one.done(recorded)
    if not one.may_fall:
        done &= ~env.falls(recorded[:-1], recorded[1:]).any(axis=0)
    return recorded, done
