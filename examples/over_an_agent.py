"""PPO learns a task over an agent, which it tells where to go every 25 control steps.

The task: be on the middle of the ledge, which is reached by the ramp alone. Its reward is 0
everywhere else, so that of the body's own actions PPO learns nothing; of goals it soon does.

    pip install ".[peers]"
    python examples/over_an_agent.py
"""

import sys
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

import everystate
import everystate.envs

HELD = 25  # control steps for which a goal is held


class OnTheLedge(gymnasium.Wrapper):
    """1 for every control step that ends on the middle of the ledge."""

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One control step."""
        state, _, ended, cut, info = self.env.step(action)
        x, y = state
        return state, float(abs(x) < 0.3 and y > 0.6), ended, cut, info


def practise(env: gymnasium.Env, steps: int, rollout: int) -> str:
    """What an episode brings before and after so many steps."""
    env = Monitor(env)
    env.reset(seed=0)
    model = PPO("MlpPolicy", env, n_steps=rollout, batch_size=50, learning_rate=3e-3, seed=0)
    before, _ = evaluate_policy(model, env, n_eval_episodes=10)
    model.learn(steps)
    after, _ = evaluate_policy(model, env, n_eval_episodes=10)
    return f"{before:.0f} before practice, {after:.0f} after"


goals = int(sys.argv[1]) if len(sys.argv) > 1 else 1000  # to practise with
task = OnTheLedge(gymnasium.make("everystate/RampPointmass-v0", max_episode_steps=4 * HELD))
over = everystate.GoalReaching(task, everystate.load("ramp-pointmass"), steps=HELD)
print("steps on the ledge, of 100, with as much practice:")
print("by goals for the agent:", practise(over, goals, rollout=50))
print("by the body's own actions:", practise(task, goals * HELD, rollout=50 * HELD))
