"""How well an agent of the cartpole knows the surroundings of balance.

    python experiments/cartpole_inside.py RUN [RUN ...]

Prints one JSON object per run, and keeps it, with what evaluations in training found, as
`results/cartpole-notes/inside/NAME.json`: for how many of 250 steps the policy keeps a pole within
18 degrees that it is given upright, over 20 starts; and for carts at rest beside the goal under an
upright pole, what V says and what the policy then collects in 100 steps through d, by V's count.
`inside.png` beside that folder has all that is in it.
"""

import json
import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

import everystate
from everystate import Agent
from everystate.agent import keep_compiled_programs
from everystate.envs import make
from everystate.evaluation import rollout
from everystate.learning.flows import decode
from everystate.learning.rewards import closeness, placing
from everystate.learning.value import remaining
from everystate.training.logging import read_metrics
from everystate.viewing.plots import COLOURS, WIDTH, styled

FOLDER = Path(__file__).resolve().parent.parent / "results" / "cartpole-notes" / "inside"
STARTS, STEPS = 20, 250
UPRIGHT = np.array([0.0, 1.0, 0.0, 0.0, 0.0], dtype=np.float32)
PLACES = np.round(np.linspace(-0.6, 0.6, 13), 2)


def steps_upright(agent: Agent) -> list[int]:
    """Until the pole first leaves the top, from within 0.3 m of the middle and 0.05 rad of it."""
    rng = np.random.default_rng(0)
    angle = rng.uniform(-0.05, 0.05, STARTS)
    x, zero = rng.uniform(-0.3, 0.3, STARTS), np.zeros(STARTS)
    starts = np.stack([x, np.cos(angle), np.sin(angle), zero, zero], axis=1)
    goals = np.tile(UPRIGHT, (STARTS, 1))
    env = make("cartpole", STARTS, 0)
    states = rollout(agent, env, starts, goals, STEPS, plan=False, seed=0)
    fallen = states[1:, :, 1] < np.cos(np.radians(18))
    return np.where(fallen.any(axis=0), fallen.argmax(axis=0), STEPS).tolist()


def collected(agent: Agent, states: Float[np.ndarray, "n 5"]) -> list[float]:
    """What the policy's centre gains in 100 steps through the centre of d, and V after them."""
    config, models = agent.config, agent.models
    place = placing(config, models)
    centre, spread = np.asarray(agent.scale.centre), np.asarray(agent.scale.spread)
    goal = jnp.asarray((UPRIGHT - centre) / spread)

    def of_one(state: Float[Array, "5"]) -> Float[Array, ""]:
        def step(s: Array, _: None) -> tuple[Array, Array]:
            action = jnp.clip(decode(models.policy(s, goal), jnp.zeros(1)), -1, 1)
            after = decode(models.dynamics(s, action), jnp.zeros(5))
            return after, closeness(config, place(after), place(goal))

        last, near = jax.lax.scan(step, state, length=100)
        weights = jnp.cumprod(jnp.append(1.0, remaining(config, near)))
        return weights @ jnp.append(near - 1, jnp.minimum(models.value(last, goal), 0.0))

    return jax.jit(jax.vmap(of_one))(jnp.asarray((states - centre) / spread)).tolist()


def inside(run: Path) -> dict[str, Any]:
    """All of it, for one run."""
    agent = everystate.load(run)
    beside = np.tile(UPRIGHT, (len(PLACES), 1))
    beside[:, 0] = PLACES
    upright = steps_upright(agent)
    found = ("epoch", "time/elapsed_s", "eval/")
    lines = [{n: x for n, x in line.items() if n.startswith(found)} for line in read_metrics(run)]
    return {
        "command": f"python experiments/cartpole_inside.py {run.name}",
        "steps_upright": {"mean": float(np.mean(upright)), "each": upright},
        "x": PLACES.tolist(),
        "value": agent.value(beside, UPRIGHT).astype(float).round(2).tolist(),
        "collected": np.round(collected(agent, beside), 2).tolist(),
        "training": [line for line in lines if len(line) > 2],
    }


@styled
def draw(found: dict[str, dict[str, Any]]) -> Figure:
    """Steps upright of each run, the shortest first; V and what is collected, of two of them."""
    found = dict(sorted(found.items(), key=lambda item: item[1]["steps_upright"]["mean"]))
    figure = Figure(figsize=(WIDTH, 3.2))
    left, right = figure.subplots(1, 2)
    for row, one in enumerate(found.values()):
        left.barh(row, one["steps_upright"]["mean"], color=COLOURS[0], alpha=0.4)
        left.plot(one["steps_upright"]["each"], [row] * STARTS, ".", color=COLOURS[0], markersize=3)
    left.set_yticks(range(len(found)), list(found))
    left.set(title="steps that the policy stays upright", xlim=(0, 1.02 * STEPS))
    for colour, name in zip(COLOURS, ("absorb-tenth", list(found)[-1]), strict=False):
        x, value, gained = (found[name][line] for line in ("x", "value", "collected"))
        right.plot(x, value, "-", color=colour, label=f"{name}: V")
        right.plot(x, gained, ":", color=colour, label="collected through d")
    right.set(title="upright, at rest, beside the goal", xlabel="x of the cart [m]")
    right.legend(fontsize=7)
    return figure


if __name__ == "__main__":
    keep_compiled_programs()
    FOLDER.mkdir(parents=True, exist_ok=True)
    for argument in sys.argv[1:]:
        result = inside(Path(argument))
        (FOLDER / f"{Path(argument).name}.json").write_text(json.dumps(result, indent=1) + "\n")
        print(json.dumps({n: result[n] for n in ("command", "steps_upright")}), flush=True)
    kept = {file.stem: json.loads(file.read_text()) for file in FOLDER.glob("*.json")}
    draw(kept).savefig(FOLDER.with_suffix(".png"), dpi=150)
