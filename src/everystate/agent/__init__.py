"""A trained agent: what it does, and how it is kept on disk."""

from everystate.agent.agent import Agent
from everystate.agent.arrays import is_array, named_arrays, own, skeleton, with_arrays
from everystate.agent.compile_cache import keep_compiled_programs
from everystate.agent.files import ActWith, BodyInfo
from everystate.agent.goal_reaching import GoalReaching
from everystate.agent.json_files import (
    config_from_json,
    config_to_json,
    config_to_plain,
    with_model_copy,
)
from everystate.agent.loading import load
from everystate.agent.performance import Performance, step_seed

__all__ = [
    "ActWith",
    "Agent",
    "BodyInfo",
    "GoalReaching",
    "Performance",
    "config_from_json",
    "config_to_json",
    "config_to_plain",
    "is_array",
    "keep_compiled_programs",
    "load",
    "named_arrays",
    "own",
    "skeleton",
    "step_seed",
    "with_arrays",
    "with_model_copy",
]
