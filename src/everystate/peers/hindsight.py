"""Stable-Baselines3's SAC, and sb3-contrib's TQC, with hindsight experience replay.

Settings are those that the library's zoo uses for tasks with goals, but for the discount, as a body
here takes up to a hundred steps to its goal, and for how often it learns: many bodies at once.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from jaxtyping import Float32
from sb3_contrib import TQC
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback

from everystate import envs
from everystate.evaluation import suites
from everystate.peers.agents import PeerConfig
from everystate.peers.goal_env import GoalVecEnv

NUM_ENVS = 50
SETTINGS: dict[str, Any] = {
    "buffer_size": 1_000_000,
    "batch_size": 256,
    "gamma": 0.98,
    "learning_rate": 1e-3,
    "tau": 0.05,
    "train_freq": 1,
    "gradient_steps": 8,
    "policy_kwargs": {"net_arch": [256, 256, 256]},
    "replay_buffer_kwargs": {"n_sampled_goal": 4, "goal_selection_strategy": "future"},
}
_ALGORITHMS: dict[str, type[SAC | TQC]] = {"sac-her": SAC, "tqc-her": TQC}


class HindsightAgent:
    """The peer, as an evaluation wants it."""

    def __init__(self, config: PeerConfig) -> None:
        """Untrained; PyTorch gets one thread, as each run of a comparison has one core."""
        torch.set_num_threads(1)
        options = envs.parse_options(config.body_options)
        body = envs.make(config.body, NUM_ENVS, config.seed, **options)
        suite = suites.load(config.body, options=config.body_options)
        self.config, self.env = config, GoalVecEnv(body, suite, config.seed)
        self.model = _ALGORITHMS[config.agent](
            "MultiInputPolicy",
            self.env,
            replay_buffer_class=HerReplayBuffer,
            # Hindsight needs whole episodes.
            learning_starts=NUM_ENVS * (self.env.episode_steps + 1),
            seed=config.seed,
            device="cpu",
            **config.settings,
        )

    def learn(self, seconds: float, watch: Callable[[int, float], None], period: float) -> None:
        """Learns for so long by the clock, and calls `watch(steps, seconds)` every `period` s."""
        self.model.learn(10**9, callback=_Clock(seconds, watch, period))

    def act(
        self, observation: Any, goal: Any, *, plan: bool = False, seed: int = 0
    ) -> Float32[np.ndarray, "n action"]:
        """What the policy does without its noise; it cannot plan."""
        return self.model.predict(self._asked(observation, goal), deterministic=True)[0]

    def steps_to_goal(self, observation: Any, goal: Any) -> Float32[np.ndarray, " n"]:
        """From the critic: how many discounted steps of -1 its value amounts to."""
        policy = self.model.policy
        asked, _ = policy.obs_to_tensor(self._asked(observation, goal))
        with torch.no_grad():
            critics = self.model.critic(asked, self.model.actor(asked, True))
            # TQC has quantiles of returns from each critic, SAC one number.
            value = (
                critics.mean((1, 2))
                if isinstance(self.model, TQC)
                else torch.cat(critics, 1).amin(1)
            )
        gamma = self.config.settings["gamma"]
        left = np.maximum(1 + (1 - gamma) * value.numpy(), 1e-3)
        return (np.log(left) / np.log(gamma)).astype(np.float32)

    def _asked(self, observation: Any, goal: Any) -> Mapping[str, Float32[np.ndarray, "n state"]]:
        states, goals = np.broadcast_arrays(observation, goal)
        scaled = self.env.scaled(states)
        names = "observation", "achieved_goal", "desired_goal"
        return dict(zip(names, (scaled, scaled, self.env.scaled(goals)), strict=True))


class _Clock(BaseCallback):
    """Stops when the time is over, and calls somebody now and then."""

    def __init__(self, seconds: float, watch: Callable[[int, float], None], period: float) -> None:
        super().__init__()
        self._seconds, self._watch, self._period = seconds, watch, period

    def _on_training_start(self) -> None:
        self._began, self._next = time.perf_counter(), 0.0

    def _on_step(self) -> bool:
        elapsed = time.perf_counter() - self._began
        if elapsed >= self._next:
            self._watch(self.num_timesteps, elapsed)
            self._next += self._period
        return elapsed < self._seconds
