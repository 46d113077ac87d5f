"""A trained agent as its user holds it: everything in the body's own units, NumPy in and out."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.spaces import Box
from jaxtyping import Array, Float, Float32
from numpy.typing import ArrayLike

from everystate import skills
from everystate.agent import compiled, files, inputs, policy_file
from everystate.agent.files import ActWith, BodyInfo
from everystate.agent.outputs import Plan, Unit, returned
from everystate.agent.performance import Performance
from everystate.agent.steps import as_steps
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.features import features, parts
from everystate.goals import Goal
from everystate.learning.completion import Atlas
from everystate.learning.components import asked
from everystate.learning.models import Models, Scale
from everystate.learning.planning import Planned, Planning


@final
@dataclass(frozen=True, repr=False)
class Agent:
    """A trained agent: where to go is its user's choice, how to get there is what it learned.

    Every method takes a single state `[state]` or a batch `[n, state]`, in the units of the body,
    and returns float32 NumPy arrays. A goal may ask for a part of a state: NaN in the place of what
    does not matter or, by names, `{"cart": 0.5}` or `{"height": 0.6, "forward_velocity": 0.5}`;
    names are those of `state_names` and `feature_names`. A state of the wrong shape, or with a
    component that is not finite, raises an `EverystateError`.
    """

    models: Models
    scale: Scale
    config: Config
    body: BodyInfo
    act_with: ActWith = "policy"
    """What drives it best: the studio, films and reports do as it says unless told otherwise."""
    visited: Float32[np.ndarray, "n state"] | None = None
    """States in which its body has been, from which it completes goals that ask for a part."""

    def __repr__(self) -> str:
        sizes = f"{len(self.state_names)} state components, {self.body.action_size} actions"
        return f"Agent({self.config.body}: {sizes}, acts with {self.act_with})"

    @property
    def state_names(self) -> tuple[str, ...]:
        """Of the components of its states and goals, in order."""
        return self.body.state_names

    @property
    def feature_names(self) -> tuple[str, ...]:
        """Of what else a goal may ask for by name: see `everystate.features`."""
        return tuple(features(self.state_names))

    @property
    def action_names(self) -> tuple[str, ...]:
        """Of the components of its actions, in order; `action_0` and so on if it knows none."""
        known = self.body.action_names
        return known or tuple(f"action_{i}" for i in range(self.body.action_size))

    @property
    def observation_space(self) -> Box:
        """Of its states and goals: any numbers, float32, in the order of `state_names`."""
        return Box(-np.inf, np.inf, (len(self.state_names),), np.float32)

    @property
    def action_space(self) -> Box:
        """Of its actions: from -1 to 1 each, float32."""
        return Box(-1.0, 1.0, (self.body.action_size,), np.float32)

    @property
    def units(self) -> dict[str, Unit]:
        """Centre and spread of each component of the state, by its name."""
        centre, spread = (np.asarray(x).tolist() for x in self.scale)
        return dict(zip(self.state_names, map(Unit, centre, spread), strict=True))

    def act(
        self,
        observation: ArrayLike,
        goal: Goal,
        *,
        plan: bool | Planning = False,
        seed: int = 0,
    ) -> Float32[np.ndarray, "*n action"]:
        """The action, in [-1, 1], that leads from each state towards its goal.

        Where there is a policy to pass goals and one to hold them, a goal that can be held is held
        from where it is nearly met, and where to pass it first would be no sooner [D31].

        Without `plan` it is the policy's most central one (z = 0). With it, a short search through
        the learned dynamics and value (4.2, 4.3) corrects that where it is sure to do better:
        slower, and deterministic for a `seed`; a `Planning` says how far and how hard to search.
        Either argument may be a batch.
        """
        states, goals, single = self._pairs(observation, goal)
        if plan:
            planning = plan if isinstance(plan, Planning) else Planning()
            actions = self._search(states, goals, planning, seed).actions[:, 0]
        else:
            actions = compiled.act(self.config, self.models, states, goals)
        return returned(actions, single)

    def complete(self, observation: ArrayLike, goal: Goal) -> Float32[np.ndarray, "*n state"]:
        """The whole state for which the agent makes at the moment, sent to a part of one.

        Of the states that fit what is asked, as far as the agent knows them, that on the way to
        which, as it imagines it, what is asked is met soonest and longest. It is chosen anew at
        every step.
        """
        _, goals, single = self._pairs(observation, goal)
        given = inputs.pairs(observation, goal, self.state_names).goals.components
        whole = np.where(np.isnan(given), self.scale.unscaled(goals), given)  # not rounded twice
        return np.array(whole[0] if single else whole)

    def plan(
        self,
        observation: ArrayLike,
        goal: Goal,
        *,
        planning: Planning | None = None,
        seed: int = 0,
    ) -> Plan:
        """The few actions in a row of which `act` with `plan` returns the first, and their way."""
        states, goals, single = self._pairs(observation, goal)
        found = self._search(states, goals, planning or Planning(), seed)
        way = self.scale.unscaled(compiled.ahead(self.models, states, found.actions))
        every = Plan(*map(np.asarray, (found.actions, way, *found[1:])))
        return Plan(*(x[0] for x in every)) if single else every

    def predict(
        self, observation: ArrayLike, goal: Goal, deterministic: bool = True, *, seed: int = 0
    ) -> tuple[Float32[np.ndarray, "*n action"], None]:
        """The policy's action, in the manner of Stable-Baselines3; it has no state: None.

        If `deterministic`, the most central one, as `act` gives. Otherwise one that is drawn from
        the policy: the same for the same `seed`, so give another at every step. Either argument may
        be a batch, whose actions are drawn independently.
        """
        if deterministic:
            return self.act(observation, goal), None
        states, goals, single = self._pairs(observation, goal)
        actions = compiled.sample(self.config, self.models, states, goals, jax.random.key(seed))
        return returned(actions, single), None

    def perform(self, skill: str, *, plan: bool = False, seed: int = 0) -> Performance:
        """Performs a named skill: call what is returned with each observation in turn.

        `everystate skills BODY` lists them. Raises an `EverystateError` for one that is not there.
        """
        return Performance(self, skills.skill(self.config.body, skill), plan, seed)

    def propose_goals(self, n: int, seed: int = 0) -> Float32[np.ndarray, "n state"]:
        """Goals worth exploring: each the least likely of m states the agent imagines (4.1)."""
        if n < 1:
            raise EverystateError(f"n is {n}: propose at least one goal")
        keys = jax.random.split(jax.random.key(seed), n)
        return np.array(self.scale.unscaled(compiled.propose(self.config.m, self.models, keys)))

    def value(self, observation: ArrayLike, goal: Goal) -> Float32[np.ndarray, "*n"]:
        """V(s, g): what the agent expects on its way, in steps, at most 0 (4.2) [D31]."""
        states, goals, single = self._pairs(observation, goal)
        return returned(compiled.values(self.config, self.models, states, goals), single)

    def steps_to_goal(self, observation: ArrayLike, goal: Goal) -> Float32[np.ndarray, "*n"]:
        """About how many control steps each state is from its goal: -V(s, g) (4.2) [D18], [D31].

        By the paper's sum the step onto the goal costs nothing, as the reward is that of the state
        arrived at: from afar the true value is one step less than the distance.
        """
        states, goals, single = self._pairs(observation, goal)
        return returned(compiled.steps(self.config, self.models, states, goals), single)

    def log_density(self, state: ArrayLike) -> Float32[np.ndarray, "*n"]:
        """log p_f(s): how much of its life the agent has lately spent around each state.

        A density per unit of state, in nats: it integrates to 1 over the body's own units.
        """
        states = inputs.checked("state", state, self.state_names)
        scaled = self.scale.scaled(jnp.atleast_2d(jnp.asarray(states)))
        density = compiled.log_density(self.models, scaled) - jnp.log(self.scale.spread).sum()
        return returned(density, states.ndim == 1)

    def export(
        self, path: str | Path, scores: Mapping[str, Any] | None = None, *, half: bool = False
    ) -> Path:
        """Writes the agent to where `load` reads it, on any machine and without running code.

        The copy of a model file that was the user's own goes with it. What drives it best goes too:
        `dataclasses.replace(agent, act_with="plan")` is an agent that says so.

        NAME.onnx and NAME.npz hold the policy alone, for programs without JAX: `act` without
        `plan`, but for rounding. The first needs the package onnx; its inputs are `observation` and
        `goal` [batch, state], in the body's units, its output `action` [batch, action], all
        float32. The other is for `everystate.portable.load`.

        Args:
            path: the folder or, by its ending, the one file; it must not exist.
            scores: results to keep with it, anything JSON can hold; not with a policy alone.
            half: matrices as float16, for half the size; it then acts a little differently. Not
                with a policy alone.

        Raises:
            EverystateError: it exists, cannot be written, or cannot be written in this form.
        """
        path = Path(path)
        if policy_file.is_one(path):
            policy_file.require_nothing_else(path, scores, half)
            names = self.state_names, self.action_names
            return policy_file.write(path, as_steps(self.models, self.scale, self.config, *names))
        agent = self.models, self.scale, self.config, self.body, self.act_with, self.visited
        return files.export(path, *agent, scores, half)

    @cached_property
    def _atlas(self) -> Atlas:
        states = None if self.visited is None else jnp.asarray(self.visited)
        return compiled.atlas(self.config, self.models, self.scale, states)

    def _search(
        self, states: Float[Array, "n s"], goals: Float[Array, "n s"], planning: Planning, seed: int
    ) -> Planned:
        key = jax.random.key(seed)
        return compiled.plan(self.config, planning, self.models, states, goals, key)

    def _pairs(
        self, observation: ArrayLike, goal: Goal
    ) -> tuple[Float[Array, "n s"], Float[Array, "n s"], bool]:
        """Both scaled, as batches of the same length, the goals whole; and if both came single."""
        states, wanted, single = inputs.pairs(observation, goal, self.state_names)
        goals = jnp.asarray(wanted.components)
        if wanted.features or np.isnan(wanted.components).any():
            known = self.config, self.models, self.scale, parts(self.state_names), self._atlas
            free = np.full(len(states), np.nan, np.float32)
            names = self.feature_names if wanted.features else ()  # all: one program does for any
            features = {name: wanted.features.get(name, free) for name in names}
            asked_for = jax.tree.map(jnp.asarray, (states, wanted.components, features))
            goals = compiled.completed(*known, *asked_for)
        here, there = self.scale.scaled(jnp.asarray(states)), self.scale.scaled(goals)
        return here, asked(self.models.dynamics.weights, here, there), single
