"""A body as Stable-Baselines3 wants it for hindsight: goals are whole states."""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from jaxtyping import Float, Float32
from stable_baselines3.common.vec_env import VecEnv

from everystate.envs import BodyVectorEnv, random_play
from everystate.evaluation import metrics
from everystate.evaluation.suite import Suite

GOAL_EPS = 0.5
"""The reward asks for what success@0.5 asks for: the peer is trained on what is measured."""
_REMEMBERED = 100_000  # states from which goals are drawn
_PLAYED = 2_500  # of them, by random actions, before there are others

Observation = dict[str, Float32[np.ndarray, "envs state"]]


class GoalVecEnv(VecEnv):
    """All bodies at once; episodes of one length, each with a new goal.

    States are scaled as for our agent. Goals are drawn among the last states visited: without a
    goal space there is nothing else to draw from. Being at a goal ends nothing. With d_i the
    distance of a scored component in units of sigma, the reward is

        sparse   0 where max |d_i| <= `GOAL_EPS`, -1 elsewhere
        dense    exp(-mean d_i^2) - 1: like ours (4.2), on the states themselves. The mean, not the
                 sum, as with 29 components the kernel of a sum is 0 nearly everywhere
    """

    def __init__(
        self,
        body: BodyVectorEnv,
        suite: Suite,
        seed: int,
        *,
        reward: Literal["sparse", "dense"] = "sparse",
        resets: bool = True,
    ) -> None:
        """Makes the bodies' episodes.

        Args:
            body: all bodies.
            suite: gives the units of the reward, and its longest horizon is an episode's.
            seed: of the goals.
            reward: see above.
            resets: whether an episode starts from a new initial state; otherwise it starts where
                the last one ended, as with ours, and only a body that ends is put back.
        """
        self.body, self.suite = body, suite
        self._dense, self._resets = reward == "dense", resets
        self.episode_steps = int(suite.horizons.max())
        self._rng = np.random.default_rng(seed)
        self._seen: Callable[[Float32[np.ndarray, "envs state"]], None] | None = None
        size = len(body.state_names)
        self._visited, self._count = np.zeros((_REMEMBERED, size), np.float32), 0
        for states in random_play(body, -(-_PLAYED // body.num_envs), seed):
            self._remember(states)
        box = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        names = ("observation", "achieved_goal", "desired_goal")
        space = gymnasium.spaces.Dict(dict.fromkeys(names, box))
        super().__init__(body.num_envs, space, body.single_action_space)
        self.reset()

    def watch(self, seen: Callable[[Float32[np.ndarray, "envs state"]], None]) -> None:
        """Calls this with the states of every step, in the body's units."""
        self._seen = seen

    def reset(self) -> Observation:
        self._states, _ = self.body.reset()
        return self._episode()

    def step_async(self, actions: Float[np.ndarray, "envs action"]) -> None:
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[Observation, Float32[np.ndarray, " envs"], np.ndarray, list[dict[str, Any]]]:
        after, _, ended, _, info = self.body.step(self._actions)
        reached = info.get("final_obs", after)
        if self._seen is not None:
            self._seen(reached)
        self._remember(reached)
        self._states, self._steps = after, self._steps + 1
        final = self._observation(reached)
        rewards = self.compute_reward(final["achieved_goal"], final["desired_goal"])
        over = self._steps == self.episode_steps
        done = np.ones(self.num_envs, dtype=bool) if over else ended
        if over:
            observation = self.reset() if self._resets else self._episode()
        else:
            observation = self._observation(after)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done):
            infos[i]["terminal_observation"] = {name: x[i] for name, x in final.items()}
            infos[i]["TimeLimit.truncated"] = over and not ended[i]
        return observation, rewards, done, infos

    def compute_reward(
        self,
        achieved: Float32[np.ndarray, "n state"],
        desired: Float32[np.ndarray, "n state"],
        *_: object,
    ) -> Float32[np.ndarray, " n"]:
        """Of scaled states and goals."""
        states, goals = self.body.scored(self._own(achieved)), self.body.scored(self._own(desired))
        angular = self.suite.mask(self.suite.angular)
        (apart,) = metrics.differences(states[None], goals, self.suite.sigma, angular)
        if self._dense:
            return np.expm1(-(apart**2).mean(axis=1)).astype(np.float32)
        return np.where(apart.max(axis=1) <= GOAL_EPS, 0, -1).astype(np.float32)

    def scaled(self, states: Float[np.ndarray, "n state"]) -> Float32[np.ndarray, "n state"]:
        """As the peer sees them."""
        scaling = self.body.scaling
        return ((states - scaling.centre) / scaling.spread).astype(np.float32)

    def _episode(self) -> Observation:
        """A new one, from where the bodies are."""
        self._steps = 0
        self._goals = self._drawn()
        return self._observation(self._states)

    def _own(self, scaled: Float32[np.ndarray, "n state"]) -> Float[np.ndarray, "n state"]:
        scaling = self.body.scaling
        return scaled * scaling.spread + scaling.centre

    def _observation(self, states: Float32[np.ndarray, "envs state"]) -> Observation:
        scaled = self.scaled(states)
        return {
            "observation": scaled,
            "achieved_goal": scaled.copy(),
            "desired_goal": self.scaled(self._goals),
        }

    def _remember(self, states: Float32[np.ndarray, "envs state"]) -> None:
        slots = (self._count + np.arange(len(states))) % _REMEMBERED
        self._visited[slots] = states
        self._count += len(states)

    def _drawn(self) -> Float32[np.ndarray, "envs state"]:
        filled = min(self._count, _REMEMBERED)
        return self._visited[self._rng.integers(filled, size=self.num_envs)]

    # --- What else Stable-Baselines3 asks of its environments ---

    def close(self) -> None:
        self.body.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self, attr_name, None)] * self._how_many(indices)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        return [getattr(self, method_name)(*method_args, **method_kwargs)] * self._how_many(indices)

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        return [False] * self._how_many(indices)

    def _how_many(self, indices: int | Sequence[int] | None) -> int:
        return len(list(self._get_indices(indices)))
