"""Agents that teach themselves to reach every state of their body.

    import everystate
    run = everystate.train("ramp-pointmass")
    agent = everystate.load(run)
    action = agent.act(observation, goal)

Names are imported when they are first used, so that `import everystate` and `everystate --help`
take no time.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from everystate import envs, evaluation, portable
    from everystate.agent import Agent, GoalReaching, load
    from everystate.config import Config
    from everystate.errors import EverystateError
    from everystate.presets import preset
    from everystate.training import Tracker, train

_MODULES = ("envs", "evaluation", "portable")
__all__ = [
    "Agent",
    "Config",
    "EverystateError",
    "GoalReaching",
    "Tracker",
    "envs",
    "evaluation",
    "load",
    "portable",
    "preset",
    "train",
]

_HOMES = {
    "Agent": "agent",
    "Config": "config",
    "EverystateError": "errors",
    "GoalReaching": "agent",
    "Tracker": "training",
    "load": "agent",
    "preset": "presets",
    "train": "training",
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"everystate.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module 'everystate' has no attribute {name!r}")
    return getattr(importlib.import_module(f"everystate.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
