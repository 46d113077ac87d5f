"""One body, alive under an agent: what the studio shows, without the page around it."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from everystate.agent import Agent, Performance, step_seed
from everystate.envs import BodyVectorEnv, MujocoVectorEnv, make, parse_options
from everystate.errors import EverystateError
from everystate.evaluation import suites, warn_of_another_model
from everystate.goals import Goal
from everystate.viewing.pursuit import Pursuit, distance
from everystate.viewing.push import pulled
from everystate.viewing.recording import Recording

JOLT = 0.5
"""A push changes each velocity by about this many spreads."""
MASSES = (0.25, 4.0)
"""Least and largest factor of all masses."""

State = Float32[np.ndarray, " state"]
Do = Callable[[str, Callable[[], None]], None]
"""Has something done between two steps, in the place of what else that control asked for."""


REMEMBERED = 250
"""Control steps that a world remembers."""


class Thoughts(NamedTuple):
    """What the agent thinks of the last steps, and how far from its goals it then was."""

    steps_to_goal: Float32[np.ndarray, " steps"]
    """-V(s, g)."""
    distance: Float[np.ndarray, " steps"]
    """In σ, as a `Pursuit` measures it."""
    log_density: Float32[np.ndarray, " steps"]


class World:
    """A body that is sent from goal to goal, pushed about and made heavier."""

    def __init__(self, agent: Agent, seed: int = 0, *, plan: bool | None = None) -> None:
        """Begins where the body does, with its own state as its goal.

        It plans if `plan`, or else as the agent says.
        """
        self.agent = agent
        self.plan = agent.act_with == "plan" if plan is None else plan
        self.pessimistic = agent.config.pessimism != "mean"
        self.mass = 1.0
        self._rng = np.random.default_rng(seed)
        self._seed, self.steps = seed, 0
        self.env = self._made()
        self._begin(self.env.reset(seed=seed)[0][0])

    def _begin(self, state: State) -> None:
        self.state = state
        self._states = self._goals = np.tile(state, (REMEMBERED, 1))
        self._distances = np.zeros(REMEMBERED)
        self._trail, self.heading = np.zeros((REMEMBERED, 2)), 0.0
        self._lived = 0
        self.send(state, "stay here")

    def restart(self) -> None:
        """Puts the body where it begins, with that as its goal, and forgets its way."""
        self._begin(self.env.reset()[0][0])

    @property
    def asked(self) -> Goal:
        """What it was sent to: of a skill, the goal that is next."""
        return self._performance.goal if self._performance else self._asked

    def send(self, goal: Goal, name: str = "goal") -> None:
        """Goes to a state, or a part of one, and stays there if it can.

        Raises:
            EverystateError: see `Agent.act`.
        """
        self.goal: State = self.agent.complete(self.state, goal)
        self._performance: Performance | None = None
        self._asked = goal
        self._pursue(name)

    def perform(self, skill: str) -> None:
        """Performs a named skill, and goes on with its last goal."""
        self._performance = self._acting().perform(skill, plan=self.plan, seed=self._seed)
        self.goal = self.agent.complete(self.state, self._performance.goal)
        self._pursue(skill)

    def _pursue(self, name: str) -> None:
        skill = self._performance.skill if self._performance else None
        self.pursuit = Pursuit(name, skill, [self.state])
        self.ahead: Float32[np.ndarray, "horizon+1 state"] | None = None

    def surprise(self) -> None:
        """Goes to a goal that the agent proposes."""
        self.send(self.agent.propose_goals(1, int(self._rng.integers(2**31)))[0], "surprise")

    def anywhere(self) -> None:
        """Goes to one of the goals of the body's suite, all of which it can be in."""
        config = self.agent.config
        goals = suites.load(config.body, options=config.body_options).goals
        self.send(goals[self._rng.integers(len(goals))], "anywhere")

    def push(self) -> None:
        """Jolts its velocities, or its place if it has none."""
        names = self.env.state_names
        moving = np.array([unit.endswith("/s") for unit in self.env.state_units])
        hit = moving if moving.any() else np.ones(len(names), dtype=bool)
        jolt = (
            JOLT * np.asarray(self.agent.scale.spread) * self._rng.choice([-1.0, 1.0], len(names))
        )
        self._put(self.state + np.where(hit, jolt, 0.0))

    def pull(self, part: int, start: Float[np.ndarray, " 3"], end: Float[np.ndarray, " 3"]) -> None:
        """Jolts a point of one of the model's bodies towards another point; see `push.pulled`."""
        if isinstance(self.env, MujocoVectorEnv):
            pull = self.env.model, self.env.body, self.state, part, start, end
            self._put(pulled(*pull, self.heading))

    def weigh(self, mass: float) -> None:
        """All masses and inertias of the body times a factor, which the agent does not know of."""
        if not MASSES[0] <= mass <= MASSES[1]:
            raise EverystateError(f"mass is {mass}: choose {MASSES[0]} to {MASSES[1]}")
        self.mass, self.env = mass, self._made()
        self._put(self.state)

    def follow(self, agent: Agent) -> None:
        """Goes on with another agent of the same body, as a run in training saves them."""
        self.agent = agent
        if self._performance:
            self._performance.agent = self._acting()

    def step(self) -> None:
        """One control step."""
        actor, asked = self._acting(), self.asked
        goal = self.goal = actor.complete(self.state, asked)
        seed = step_seed(self._seed, self.steps)
        self.ahead = None
        if self.plan:
            plan = actor.plan(self.state, goal, seed=seed)
            action, self.ahead = plan.actions[0], plan.states
            self.pursuit.planned += 1
            self.pursuit.corrected += int(plan.corrected)
        else:
            action = actor.act(self.state, goal, seed=seed)
        if self._performance:
            self._performance.step += 1
        self.steps += 1
        self._lived = min(self._lived + 1, REMEMBERED - 1)
        before, self.state = self.state, self.env.step(action[None])[0][0]
        if self.trail is not None and isinstance(self.env, MujocoVectorEnv):
            path = np.stack([before, self.state])
            x, y, self.heading = self.env.body.carried(path, self.heading)[1, :3].tolist()
            self._trail = np.concatenate([self._trail[1:], self._trail[-1:] + np.array([x, y])])
        self._states = np.concatenate([self._states[1:], self.state[None]])
        self._goals = np.concatenate([self._goals[1:], goal[None]])
        self._distances = np.append(self._distances[1:], distance(actor, self.state[None], asked))
        self.pursuit.goes_on(self.state, self._distances[-1])

    @property
    def trail(self) -> Float[np.ndarray, "steps 2"] | None:
        """Where it has been in the last steps, in metres; None if it observes where it is."""
        env = self.env
        return self._trail if isinstance(env, MujocoVectorEnv) and env.body.unseen else None

    def thoughts(self) -> Thoughts:
        """On each of the last `REMEMBERED` steps; before the first it had stood where it began."""
        states, goals = self._states, self._goals
        return Thoughts(
            self.agent.steps_to_goal(states, goals),
            self._distances,
            self.agent.log_density(states),
        )

    def recording(self) -> Recording:
        """Of what it remembers.

        Raises:
            EverystateError: it has only just begun.
        """
        if not self._lived:
            raise EverystateError("there is nothing to film: let it live for a second")
        thoughts = self.thoughts()
        last = slice(-self._lived - 1, None)
        return Recording(
            self.pursuit.name,
            self._states[last],
            self._goals[last],
            thoughts.steps_to_goal[last],
            thoughts.distance[last],
        )

    def _acting(self) -> Agent:
        """The agent, planning for the worst or for the mean of what it imagines."""
        pessimism = "percentile" if self.pessimistic else "mean"
        if self.agent.config.pessimism == pessimism:
            return self.agent
        return replace(self.agent, config=replace(self.agent.config, pessimism=pessimism))

    def _made(self) -> BodyVectorEnv:
        config = self.agent.config
        options = parse_options(config.body_options)
        if self.mass != 1.0:
            options["mass"] = self.mass * options.get("mass", 1.0)
        env = make(config.body, 1, self._seed, **options)
        warn_of_another_model(self.agent, env)
        if not env.placeable:
            raise EverystateError(f"{env.name} cannot be drawn from what it observed, only live")
        return env

    def _put(self, state: Float[np.ndarray, " state"]) -> None:
        bounds = self.env.single_observation_space
        inside = np.clip(state, bounds.low, bounds.high)  # pyright: ignore
        self.env.set_observations(inside[None])
        self.state = inside.astype(np.float32)
