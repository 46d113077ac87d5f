"""What the studio shows, as a program of its user's."""

from collections.abc import Mapping

import numpy as np

from everystate.envs import parse_options
from everystate.viewing.world import World


def as_python(world: World, agent: str) -> str:
    """A program that sends the agent, loaded by its name or path, to the goal now set."""
    env = world.env
    options = parse_options(world.agent.config.body_options)
    given = "".join(f", {name}={value!r}" for name, value in options.items())
    if isinstance(world.asked, Mapping):
        asked = world.asked.items()
        goal = str({name: float(f"{np.asarray(value).item():.4g}") for name, value in asked})
    else:
        columns = zip(env.state_names, env.state_units, world.goal, strict=True)
        lines = (
            f"    {value:.4g},  # {name}" + (f", {unit}" if unit != "1" else "")
            for name, unit, value in columns
        )
        goal = "[\n" + "\n".join(lines) + "\n]"
    plan = ", plan=True, seed=step" if world.plan else ""
    return f"""import everystate
from everystate.envs import make

agent = everystate.load({agent!r})
env = make({world.agent.config.body!r}, num_envs=1{given})
goal = {goal}
observations, _ = env.reset(seed=0)
for step in range(250):
    observations = env.step(agent.act(observations, goal{plan}))[0]
print(observations[0].round(2))
print(agent.steps_to_goal(observations, goal))
"""
