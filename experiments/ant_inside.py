"""What an agent of the ant knows and does not: python experiments/ant_inside.py RUN [RUN ...].

Prints one JSON object per run, and keeps it with the run's config and metrics in
`results/ant-notes/NAME`: how far from 200 goals of the suite the policy ends, by parts of the
state; what V makes of an ant that faces another way; where ants end that begin in the pose of
another goal, and what V makes of that; how far ants that face 90 degrees away are from their goal's
heading after 3 s by the policy; how many get up from their backs; its skills; and the share of the
variance of a step that d explains, on motions it did not choose.
"""

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import ant_controllers as ants
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import everystate
from everystate import Agent
from everystate.agent import keep_compiled_programs
from everystate.envs import BodyVectorEnv, make
from everystate.evaluation import rollout, suites
from everystate.evaluation.performances import success_rates
from everystate.learning.flows import decode
from everystate.skills import ant, ant_rules, skill

RESULTS = Path(__file__).resolve().parent.parent / "results" / "ant-notes"
PARTS = {"height": slice(0, 1), "orientation": slice(1, 7), "joints": slice(7, 15)}
PARTS |= {"velocity": slice(15, 18), "turning": slice(18, 21), "joint speeds": slice(21, 29)}


def rms(errors: Float[np.ndarray, "*n 29"]) -> dict[str, float]:
    """Root mean squares by parts, and of all."""
    parts = {name: errors[..., part] for name, part in PARTS.items()} | {"all": errors}
    return {name: round(float(np.sqrt((x**2).mean())), 3) for name, x in parts.items()}


def distances(agent: Agent, env: BodyVectorEnv, suite: suites.Suite) -> dict[str, Any]:
    """Of the policy's last states from their goals, in scaled units, by the goals' regions."""
    steps = int(suite.horizons.max())
    states = rollout(agent, env, suite.starts, suite.goals, steps, plan=False, seed=0)
    errors = (states - suite.goals) / env.scaling.spread
    regions = env.regions(suite.goals)
    return {
        name: {"start": rms(errors[0, regions == name]), "last": rms(errors[-1, regions == name])}
        for name in dict.fromkeys(regions.tolist())
    }


def turned(states: Float[np.ndarray, "n 29"], angle: float) -> Float[np.ndarray, "n 29"]:
    """The same states, facing further to the left; of those at rest."""
    cosine, sine = np.cos(angle), np.sin(angle)
    result = states.copy()
    for x in (1, 4):
        result[:, x] = cosine * states[:, x] - sine * states[:, x + 1]
        result[:, x + 1] = sine * states[:, x] + cosine * states[:, x + 1]
    return result


def value_by_heading(agent: Agent, goals: Float[np.ndarray, "n 29"]) -> dict[str, float]:
    """Mean V of states that differ from their goals in heading alone, by degrees."""
    angles = range(0, 181, 30)
    values = [agent.value(turned(goals, np.radians(a)), goals).mean() for a in angles]
    return {str(a): round(float(v), 2) for a, v in zip(angles, values, strict=True)}


def heading(states: Float[np.ndarray, "n 29"]) -> Float[np.ndarray, " n"]:
    """Radians."""
    return np.arctan2(states[:, 2], states[:, 1])


def posing(agent: Agent, goals: Float[np.ndarray, "n 29"]) -> dict[str, Any]:
    """Where ants end in 3 s that face as their goals do, each in the pose of another goal."""
    env, starts = make("ant", len(goals), 0), np.roll(goals, 1, axis=0)
    ways = heading(goals) - heading(starts)
    starts = np.concatenate([turned(s[None], way) for s, way in zip(starts, ways, strict=True)])
    last = rollout(agent, env, starts, goals, 60, plan=False, seed=0)[-1]
    value = float(agent.value(last, goals).mean())
    return {"last": rms((last - goals) / env.scaling.spread), "value": round(value, 2)}


def degrees_left(agent: Agent, goals: Float[np.ndarray, "n 29"]) -> list[int]:
    """After 3 s by the policy, of ants that face 90 degrees away."""
    env = make("ant", len(goals), 0)
    states = rollout(agent, env, turned(goals, np.pi / 2), goals, 60, plan=False, seed=0)
    error = (heading(states[-1]) - heading(goals) + np.pi) % (2 * np.pi) - np.pi
    return np.degrees(error).round().astype(int).tolist()


def got_up(agent: Agent, num: int = 20) -> dict[str, float]:
    """Share of ants on their backs that are upright after 5 and 10 s by the policy."""
    env, lying = make("ant", num, 0), skill("ant", "feet-up").starts
    starts = lying(np.random.default_rng(0), num).astype(np.float32)
    goals = np.tile(np.array(ant.state(ant.STANDS), np.float32), (num, 1))
    states = rollout(agent, env, starts, goals, 200, plan=False, seed=0)
    return {f"{s} s": float((ant_rules.up(states[20 * s]) > 0.7).mean()) for s in (5, 10)}


def explained(agent: Agent, num: int = 100) -> dict[str, float]:
    """Share of the variance of s' - s that d's central prediction explains, by parts."""
    rng, env = np.random.default_rng(5), make("ant", num, 1)
    states, _ = env.reset(seed=1)
    rounds = [*ants.play(env, states, rng, rounds=4, steps=40)]
    before, actions, after = (
        jnp.asarray(np.concatenate([x.reshape(-1, x.shape[-1]) for x in column]), jnp.float32)
        for column in list(zip(*rounds, strict=True))[1:]
    )
    before, after = agent.scale.scaled(before), agent.scale.scaled(after)
    dynamics = agent.models.dynamics
    central = jax.jit(jax.vmap(lambda s, a: decode(dynamics(s, a), jnp.zeros_like(s))))
    errors, changes = central(before, actions) - after, after - before
    return {
        name: round(float(1 - (errors[:, at] ** 2).mean() / (changes[:, at] ** 2).mean()), 3)
        for name, at in PARTS.items()
    }


def main(runs: list[str]) -> None:
    """Looks into every run."""
    keep_compiled_programs()
    suite = suites.load("ant").subset(200)
    env = make("ant", len(suite.goals), 0)
    upright = suite.goals[env.regions(suite.goals) == "upright"]
    for run in map(Path, runs):
        agent = everystate.load(run)
        said = {
            "command": f"python experiments/ant_inside.py {run.name}",
            "distance": distances(agent, env, suite),
            "value_by_heading": value_by_heading(agent, upright),
            "posing": posing(agent, upright[:8]),
            "degrees_left": degrees_left(agent, upright[:8]),
            "got_up": got_up(agent),
            "skills": success_rates(agent, plan=False),
            "explained_by_d": explained(agent),
        }
        folder = RESULTS / run.name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "inside.json").write_text(json.dumps(said, indent=1) + "\n")
        for file in ("config.json", "metrics.jsonl"):
            shutil.copy(run / file, folder / file)
        print(run.name, json.dumps(said))


if __name__ == "__main__":
    main(sys.argv[1:])
