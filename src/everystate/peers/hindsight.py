"""Stable-Baselines3's SAC, and sb3-contrib's TQC, with hindsight experience replay."""

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float32
from sb3_contrib import TQC
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from everystate import envs
from everystate.evaluation import suites
from everystate.peers import acting
from everystate.peers.agents import PeerConfig
from everystate.peers.goal_env import GoalVecEnv
from everystate.peers.settings import PeerSettings

_ALGORITHMS: dict[str, type[SAC | TQC]] = {"sac": SAC, "tqc": TQC}
_INPUTS = ("observation", "achieved_goal", "desired_goal")


class HindsightAgent:
    """The peer, as an evaluation wants it."""

    def __init__(self, body: str, seed: int, name: str, settings: PeerSettings) -> None:
        """Untrained; PyTorch gets one thread, as each run of a comparison has one core."""
        torch.set_num_threads(1)
        self.settings = settings
        self.config = PeerConfig(body, (), seed, name, asdict(settings))
        self.env = GoalVecEnv(
            envs.make(body, settings.num_envs, seed),
            suites.load(body),
            seed,
            reward=settings.reward,
            resets=settings.resets,
        )
        normalizing = VecNormalize(self.env, gamma=settings.gamma) if settings.normalize else None
        self._normalizing = normalizing
        whole = settings.num_envs * (self.env.episode_steps + 1)
        self.model = _ALGORITHMS[settings.algorithm](
            "MultiInputPolicy",
            normalizing or self.env,
            buffer_size=settings.buffer_size,
            batch_size=settings.batch_size,
            gamma=settings.gamma,
            tau=settings.tau,
            learning_rate=settings.learning_rate,
            train_freq=settings.train_freq,
            gradient_steps=settings.gradient_steps,
            # Hindsight needs whole episodes.
            learning_starts=max(settings.learning_starts, whole),
            policy_kwargs={"net_arch": [*settings.net_arch], "n_critics": settings.n_critics},
            replay_buffer_class=HerReplayBuffer,
            replay_buffer_kwargs={
                "n_sampled_goal": settings.n_sampled_goal,
                "goal_selection_strategy": settings.goal_selection_strategy,
            },
            seed=seed,
            device="cpu",
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
            ).numpy()
        if self._normalizing:
            value = value * np.sqrt(self._normalizing.ret_rms.var + self._normalizing.epsilon)
        gamma = self.settings.gamma
        left = np.maximum(1 + (1 - gamma) * value, 1e-3)
        return (np.log(left) / np.log(gamma)).astype(np.float32)

    def keep(self, folder: Path) -> acting.Actor:
        """Writes what it needs to act again into a new folder, and returns what was written."""
        acting.write(self.actor(), folder)
        return replace(acting.read(folder), estimate=self.steps_to_goal)

    def actor(self) -> acting.Actor:
        """The policy without its noise, as NumPy runs it."""
        model, scaling = self.model.actor, self.env.body.scaling
        layers = [m for m in (*model.latent_pi, model.mu) if isinstance(m, torch.nn.Linear)]
        inputs = tuple(self.model.observation_space.spaces)  # concatenated in this order
        shift, scale, clip = dict.fromkeys(inputs, 0.0), dict.fromkeys(inputs, 1.0), None
        if self._normalizing:
            means = self._normalizing.obs_rms
            shift = {name: means[name].mean for name in inputs}
            scale = {n: np.sqrt(means[n].var + self._normalizing.epsilon) for n in inputs}
            clip = self._normalizing.clip_obs
        shifts = [scaling.centre + scaling.spread * shift[name] for name in inputs]
        return acting.Actor(
            config=self.config,
            inputs=inputs,
            shift=np.concatenate(shifts).astype(np.float32),
            scale=np.concatenate([scaling.spread * scale[n] for n in inputs]).astype(np.float32),
            clip=clip,
            weights=tuple(layer.weight.detach().numpy().copy() for layer in layers),
            biases=tuple(layer.bias.detach().numpy().copy() for layer in layers),
        )

    def _asked(self, observation: Any, goal: Any) -> Mapping[str, Float32[np.ndarray, "n state"]]:
        states, goals = np.broadcast_arrays(observation, goal)
        scaled = self.env.scaled(states)
        asked = dict(zip(_INPUTS, (scaled, scaled, self.env.scaled(goals)), strict=True))
        return self._normalizing.normalize_obs(asked) if self._normalizing else asked


class _Clock(BaseCallback):
    """Stops when the time is over, and calls somebody now and then, whose time does not count."""

    def __init__(self, seconds: float, watch: Callable[[int, float], None], period: float) -> None:
        super().__init__()
        self._seconds, self._watch, self._period = seconds, watch, period

    def _on_training_start(self) -> None:
        self._began, self._next = time.perf_counter(), 0.0

    def _on_step(self) -> bool:
        elapsed = time.perf_counter() - self._began
        if elapsed >= self._next:
            self._watch(self.num_timesteps, elapsed)
            self._began = time.perf_counter() - elapsed
            self._next += self._period
        return elapsed < self._seconds
