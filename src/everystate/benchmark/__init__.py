"""The suites as a benchmark for anybody's agent: goal environments, recordings and their scores.

    import gymnasium
    import everystate.benchmark
    env = gymnasium.make("everystate/CartpoleMotion-v1", split="tune")

An agent that was trained elsewhere is recorded by `record` and scored by `score`, or on the command
line by `everystate score FILE`.
"""

import gymnasium

from everystate.benchmark.environments import ENVIRONMENTS
from everystate.benchmark.recording import record, save
from everystate.benchmark.score import score
from everystate.benchmark.single_env import GoalEnv
from everystate.benchmark.vector_env import GoalVectorEnv

__all__ = ["ENVIRONMENTS", "GoalEnv", "GoalVectorEnv", "record", "save", "score"]

for _id, (_body, _suite) in ENVIRONMENTS.items():
    gymnasium.register(
        id=_id,
        entry_point="everystate.benchmark.single_env:GoalEnv",
        vector_entry_point="everystate.benchmark.vector_env:GoalVectorEnv",
        kwargs={"body": _body, "suite": _suite},
    )
