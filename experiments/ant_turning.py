"""Is it V, d or the policy that does not turn? python experiments/ant_turning.py RUN.

Sends ants that face 90 degrees away from their goal, all else alike, by the policy, by the action
that V(d(s, a)) is steepest towards, by planning through the learned d, and by the same search
through the body's own physics, and writes how far from the goal's heading they are after 3 s, in
degrees, to `results/ant-notes/RUN/turning.json`.
"""

import functools
import json
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from ant_inside import RESULTS, heading, turned
from jaxtyping import Array, Float

import everystate
from everystate import Agent
from everystate.envs import make
from everystate.evaluation import suites
from everystate.learning.flows import decode
from everystate.learning.planning import Planning
from everystate.learning.rewards import closeness

STEPS, HORIZON, CANDIDATES, ROUNDS = 60, 8, 64, 3
States = Float[np.ndarray, "ants 29"]
Actions = Float[np.ndarray, "ants 8"]


class Ascent:
    """Steps from the policy's action up the gradient of r + V at what d leads to on average."""

    def __init__(self, agent: Agent, steps: int = 10, size: float = 2.0) -> None:
        self.agent, self.steps, self.size = agent, steps, size
        self.climbed = jax.jit(jax.vmap(self._climbed))

    def _climbed(self, state: Array, goal: Array, action: Array) -> Array:
        config, models = self.agent.config, self.agent.models

        def worth(action: Array) -> Array:
            after = decode(models.dynamics(state, action), jnp.zeros_like(state))
            return closeness(config, after, goal) + config.discount * models.value(after, goal)

        def climb(action: Array, _: None) -> tuple[Array, None]:
            return jnp.clip(action + self.size * jax.grad(worth)(action), -1, 1), None

        return jax.lax.scan(climb, action, None, length=self.steps)[0]

    def __call__(self, states: States, goals: States, step: int) -> Actions:
        """An action for each ant."""
        scaled = (self.agent.scale.scaled(jnp.asarray(x)) for x in (states, goals))
        return np.asarray(self.climbed(*scaled, jnp.asarray(self.agent.act(states, goals))))


class TruePlanner:
    """The search of `learning/planning.py` without its noise, through MuJoCo instead of d."""

    def __init__(self, agent: Agent, ants: int) -> None:
        self.agent, self.rng = agent, np.random.default_rng(0)
        self.env = make("ant", ants * CANDIDATES, 0)
        self.near = jax.jit(jax.vmap(functools.partial(closeness, agent.config)))

    def worth(self, states: States, goals: States, sequences: np.ndarray) -> np.ndarray:
        """Rewards on the way and V at the end [ants, candidates], of [ants, candidates, steps]."""
        discount = self.agent.config.discount
        goals = np.repeat(goals, CANDIDATES, axis=0)
        self.env.set_observations(np.repeat(states, CANDIDATES, axis=0))
        total, after = np.zeros(len(goals)), goals
        for step in range(HORIZON):
            after = self.env.step(sequences[:, :, step].reshape(-1, 8))[0]
            places = (self.agent.scale.scaled(jnp.asarray(x)) for x in (after, goals))
            total += discount**step * (np.asarray(self.near(*places)) - 1)
        total += discount**HORIZON * self.agent.value(after, goals)
        return total.reshape(len(states), CANDIDATES)

    def __call__(self, states: States, goals: States, step: int) -> Actions:
        """The first actions of the best sequences."""
        shape = (len(states), CANDIDATES, HORIZON, 8)
        mean, spread = np.zeros((*shape[:1], 1, *shape[2:])), 0.6
        elites = mean
        for _ in range(ROUNDS):
            sequences = np.clip(mean + spread * self.rng.normal(size=shape), -1, 1)
            order = np.argsort(-self.worth(states, goals, sequences), axis=1)[:, : CANDIDATES // 8]
            elites = np.take_along_axis(sequences, order[:, :, None, None], axis=1)
            mean, spread = elites.mean(axis=1, keepdims=True), 0.05 + elites.std(axis=1)[:, None]
        return elites[:, 0, 0]


def main(run: Path, ants: int = 4) -> None:
    """Three ways of acting, from the same starts."""
    agent = everystate.load(run)
    suite = suites.load("ant")
    env = make("ant", ants, 0)
    goals = suite.goals[env.regions(suite.goals) == "upright"][:ants].astype(np.float32)
    search = Planning(candidates=CANDIDATES, rounds=ROUNDS, horizon=HORIZON)
    ways = {
        "policy": lambda s, g, step: agent.act(s, g),
        "steepest ascent through d": Ascent(agent),
        "planning": lambda s, g, step: agent.act(s, g, plan=search, seed=step),
        "planning with the true physics": TruePlanner(agent, ants),
    }
    left = {}
    for name, act in ways.items():
        states = turned(goals, np.pi / 2)
        env.set_observations(states)
        for step in range(STEPS):
            states = env.step(act(states, goals, step))[0]
        error = (heading(states) - heading(goals) + np.pi) % (2 * np.pi) - np.pi
        left[name] = np.degrees(error).round().astype(int).tolist()
        print(name, left[name], flush=True)
    said = {"command": f"python experiments/ant_turning.py {run.name}", "degrees_left": left}
    folder = RESULTS / run.name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "turning.json").write_text(json.dumps(said, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
