"""Many bodies, each on its way to a goal of a suite, as one Gymnasium environment."""

from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from jaxtyping import Bool, Float, Float32, Int, UInt8

from everystate import envs
from everystate.envs import MujocoVectorEnv
from everystate.errors import EverystateError, suggest
from everystate.evaluation import metrics, suites
from everystate.evaluation.suites import Split

Reward = Literal["sparse", "dense"]
Observation = dict[str, Float32[np.ndarray, "envs _"]]
_TOLERANCE = 0.5


class GoalVectorEnv(gymnasium.vector.VectorEnv):
    """Episodes are the tasks of a suite: from the task's start to its goal, until its horizon.

    Observations are `observation`, `achieved_goal` (the same) and `desired_goal`, each float32
    `[num_envs, state]` in the body's units; actions lie in [-1, 1]. Being at the goal ends nothing.
    An episode that is over begins anew at the next step, as Gymnasium's `NEXT_STEP` has it.

    Distances are those of `evaluation.metrics`, in units of the suite's sigma. With d the one by
    which the suite is told (`max` or `rms`), the reward is

        sparse   0 where d <= 0.5, -1 elsewhere
        dense    exp(-rms^2) - 1

    `info` has for each body its `task`; the distances `max` and `rms`; by d and within 0.25, 0.5
    and 1 what the episode has come to so far, `hit@0.5` (near the goal at any step), `end@0.5` (at
    this one) and `at@0.5` (the share of the horizon near it), and so on; and `is_success`, the one
    of them that is the suite's score.

    Where a suite of one's own asks for some components only, both goals have the weights of all
    scored components behind the state, those of an achieved goal being 1: so `compute_reward` knows
    them without `info`, and who puts achieved for desired goals asks for all components.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "autoreset_mode": AutoresetMode.NEXT_STEP,
        "render_modes": ["rgb_array"],
        "render_fps": 20,
    }

    def __init__(
        self,
        num_envs: int,
        body: str,
        suite: str | Path,
        split: Split = "tune",
        reward: Reward = "sparse",
        render_mode: str | None = None,
    ) -> None:
        """Makes the bodies; `gymnasium.make_vec` fills in `body` and `suite` by the id.

        Args:
            num_envs: how many.
            body: as in `everystate.envs.make`; one that MuJoCo moves.
            suite: one of the body's by its name, or the path of a file of one's own.
            split: "tune" draws its tasks at random, to train on and to choose settings by; those of
                "report" come in order, so that 200 bodies have one each.
            reward: see above.
            render_mode: "rgb_array", or None.

        Raises:
            EverystateError: there is no such body, suite, split or reward.
        """
        for name, value, known in (("split", split, Split), ("reward", reward, Reward)):
            if value not in get_args(known):
                raise EverystateError(
                    f"{name} is {value!r}: {suggest(str(value), get_args(known))}"
                )
        self.suite = suites.load(body, suite, split=split)
        self.bodies = envs.make(body, num_envs, render_mode=render_mode)
        if not isinstance(self.bodies, MujocoVectorEnv) or self.suite.starts is None:
            raise EverystateError(
                f"{body} with suite {str(suite)!r} cannot be put to the start of a task: choose a"
                " body that MuJoCo moves, and a suite with starts"
            )
        self.num_envs, self.split, self.render_mode = num_envs, split, render_mode
        self._dense = reward == "dense"
        self._weighted = bool((self.suite.weights != 1).any())
        self._goals = self._with_weights(self.suite.goals, self.suite.weights)
        states = self.bodies.single_observation_space
        goals = Box(-np.inf, np.inf, self._goals.shape[1:]) if self._weighted else states
        self.single_observation_space = Dict(
            {"observation": states, "achieved_goal": goals, "desired_goal": goals}
        )
        self.single_action_space = self.bodies.single_action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = self.bodies.action_space
        self._next = 0
        self._task, self._steps = np.zeros((2, num_envs), dtype=np.int64)
        self._near = np.zeros((len(metrics.EPS), num_envs), dtype=np.int64)
        self._now = np.zeros_like(self._near, dtype=bool)
        self._over = np.zeros(num_envs, dtype=bool)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """New episodes for all bodies.

        Args:
            seed: restarts the order of tasks, their draws and the body's noise.
            options: {"task": number}, one for all bodies or one each; by default as `split` says.
        """
        super().reset(seed=seed)
        if seed is not None:
            self.bodies.reset(seed=seed)
            self._next = 0
        self._over[:] = False
        self._begin(~self._over, self._asked((options or {}).get("task")))
        observation = self._observation()
        return observation, self._info(self._distances(observation))

    def step(
        self, actions: Float[np.ndarray, "envs action"]
    ) -> tuple[
        Observation,
        Float32[np.ndarray, " envs"],
        Bool[np.ndarray, " envs"],
        Bool[np.ndarray, " envs"],
        dict[str, Any],
    ]:
        """One control step; a body whose episode was over is put to its next start instead."""
        self.bodies.step(actions)
        self._steps += 1
        begun = self._over
        if begun.any():
            self._begin(begun, self._drawn(int(begun.sum())))
        observation = self._observation()
        distances = self._distances(observation)
        eps = np.array(metrics.EPS)[:, None]
        self._now = (distances[self.suite.scored_by[0]] <= eps) & ~begun
        self._near += self._now
        rewards = np.where(begun, 0, self._rewards(distances)).astype(np.float32)
        self._over = self._steps == self.suite.horizons[self._task]
        never = np.zeros(self.num_envs, dtype=bool)
        return observation, rewards, never, self._over.copy(), self._info(distances)

    def compute_reward(
        self,
        achieved_goal: Float[np.ndarray, "*n goal"],
        desired_goal: Float[np.ndarray, "*n goal"],
        info: Any = None,
    ) -> Float32[np.ndarray, "*n"]:
        """The reward of being there when sent there, one or many; `info` is not looked at."""
        achieved, desired = np.asarray(achieved_goal), np.asarray(desired_goal)
        flat = (x.reshape(-1, x.shape[-1]) for x in (achieved, desired))
        return self._rewards(self._apart(*flat)).reshape(achieved.shape[:-1])

    def render(self) -> tuple[UInt8[np.ndarray, "height width 3"], ...] | None:
        """A picture of each body, its goal a translucent ghost."""
        if self.render_mode is None:
            return None
        states = self.bodies.observe()
        return tuple(self.bodies.render_states(states, self.suite.goals[self._task]))

    def close_extras(self, **_: Any) -> None:
        self.bodies.close()

    # --- Tasks ---

    def _begin(self, which: Bool[np.ndarray, " envs"], tasks: Int[np.ndarray, " n"]) -> None:
        """Puts these bodies to the starts of these tasks."""
        assert self.suite.starts is not None
        self.bodies.set_physics([self.suite.starts[task] for task in tasks], which)
        self._task[which], self._steps[which] = tasks, 0
        self._near[:, which], self._now[:, which] = 0, False

    def _asked(self, task: Any) -> Int[np.ndarray, " envs"]:
        count = len(self.suite.goals)
        if task is None:
            return self._drawn(self.num_envs)
        tasks = np.asarray(task)
        whole = tasks.dtype.kind in "iu" and tasks.shape in ((), (self.num_envs,))
        if not whole or not ((tasks >= 0) & (tasks < count)).all():
            raise EverystateError(
                f"task is {task}: choose a whole number from 0 to {count - 1}, or one for each of"
                f" {self.num_envs} bodies"
            )
        return np.broadcast_to(tasks, self.num_envs).astype(np.int64)

    def _drawn(self, count: int) -> Int[np.ndarray, " n"]:
        """The tasks that so many bodies go on with."""
        tasks = len(self.suite.goals)
        if self.split == "tune":
            return self.np_random.integers(tasks, size=count)
        first, self._next = self._next, (self._next + count) % tasks
        return (first + np.arange(count)) % tasks

    # --- What is told of a step ---

    def _observation(self) -> Observation:
        states = self.bodies.observe()
        ones = np.ones((len(states), len(self.suite.components)))
        return {
            "observation": states,
            "achieved_goal": self._with_weights(states, ones),
            "desired_goal": self._goals[self._task],
        }

    def _with_weights(
        self, states: Float[np.ndarray, "n state"], weights: Float[np.ndarray, "n scored"]
    ) -> Float32[np.ndarray, "n goal"]:
        goals = np.concatenate([states, weights], axis=1) if self._weighted else states
        return goals.astype(np.float32)

    def _distances(self, observation: Observation) -> dict[str, Float[np.ndarray, " n"]]:
        return self._apart(observation["achieved_goal"], observation["desired_goal"])

    def _apart(
        self, achieved: Float[np.ndarray, "n goal"], desired: Float[np.ndarray, "n goal"]
    ) -> dict[str, Float[np.ndarray, " n"]]:
        """By each measure, in units of sigma."""
        size = len(self.bodies.state_names)
        states, goals = (self.bodies.scored(x[:, :size]) for x in (achieved, desired))
        angular = self.suite.mask(self.suite.angular)
        apart = metrics.differences(states[None], goals, self.suite.sigma, angular)
        weights = desired[:, size:] if self._weighted else np.ones_like(goals)
        return {"max": metrics.largest(apart, weights)[0], "rms": metrics.rms(apart, weights)[0]}

    def _rewards(self, distances: dict[str, Float[np.ndarray, " n"]]) -> Float32[np.ndarray, " n"]:
        if self._dense:
            return np.expm1(-(distances["rms"] ** 2)).astype(np.float32)
        near = distances[self.suite.scored_by[0]] <= _TOLERANCE
        return np.where(near, 0, -1).astype(np.float32)

    def _info(self, distances: dict[str, Float[np.ndarray, " envs"]]) -> dict[str, Any]:
        found: dict[str, Any] = {"task": self._task.copy(), **distances}
        horizons = self.suite.horizons[self._task]
        for eps, near, now in zip(metrics.EPS, self._near, self._now, strict=True):
            readings = {"hit": near > 0, "end": now.copy(), "at": near / horizons}
            found |= {f"{reading}@{eps:g}": values for reading, values in readings.items()}
        found["is_success"] = found[f"{self.suite.scored_by[1]}@{_TOLERANCE}"].copy()
        return found
