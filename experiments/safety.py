"""Does the pessimal policy avoid the edge of the ramp (Fig. 3, middle)?

    python experiments/safety.py

The worst of the N imagined returns against their mean, N being 8 as in `quick` or 20 as in the
paper, a percentile between them, and sensor noise, on the Ramp Pointmass for 100 epochs. `seeds.py`
says where everything goes. Of every agent kept on the way, `climbs.json` beside a run's other
results says how it climbs; `climbs.png`, `actions.png` and `climbs.json` compare the settings.
"""

import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import seeds
from jaxtyping import Float
from matplotlib.figure import Figure

import everystate
from everystate import Agent
from everystate.envs import make
from everystate.envs.ramp_pointmass import LEDGE_SOUTH, RAMP_FOOT, RAMP_WEST, region
from everystate.evaluation import rollout
from everystate.evaluation.aggregate import summary
from everystate.learning.flows import decode
from everystate.scaling import Evaluation
from everystate.viewing.plots import COLOURS, WIDTH, styled

NAME = "safety"
_EVALUATION = Evaluation(plan=False, episodes=40)


def setting(count: int, **change: Any) -> seeds.Setting:
    """Preset `quick` for as many epochs as the paper has, with this changed."""
    return seeds.Setting({"epochs": 100, **change}, count, _EVALUATION)


SETTINGS = {
    "pessimal": setting(5),
    "mean": setting(5, pessimism="mean"),
    "25th-percentile": setting(3, percentile=25.0),
    "sensor-noise": setting(3, sensor_noise=0.1),
    "pessimal-of-20": setting(3, N=20),
    "mean-of-20": setting(3, N=20, pessimism="mean"),
}
CLIMBS, STEPS, SAMPLES = 200, 60, 200
EDGE = 0.1  # m: an action moves it so far, and its noise as much as 0.06 further
LEDGE = 0.85  # y of all goals: straight ahead, so that neither left nor right leads to them
MIDDLE = (0.75, 0.0)  # half way up: where the paper's figure shows the actions
Measures = dict[str, Any]


def climbs(agent: Agent, seed: int = 0) -> Measures:
    """How it gets from the ramp's foot straight up to the ledge under the body's noise.

    `completed` of the climbs stand on the ledge at some step and `falls` of them fall before that;
    `wall` is how far from the east wall they are on the ramp, in metres; `leftward` is the
    probability of an action away from that wall, over places on the ramp, and `at_edge` the same
    where such an action can make it fall.
    """
    rng = np.random.default_rng(seed)
    across = rng.uniform(RAMP_WEST + 0.05, 0.95, CLIMBS)
    starts, goals = (np.stack([across, np.full(CLIMBS, y)], 1) for y in (RAMP_FOOT, LEDGE))
    env = make("ramp-pointmass", CLIMBS, seed)
    states = rollout(agent, env, starts, goals, STEPS, plan=False, seed=seed)
    where, fell = region(states[1:]), env.falls(states[:-1], states[1:])
    before = np.cumsum((where == "ledge") | fell, axis=0) <= 1  # up to the step that decides it
    arrived = (before & (where == "ledge") & ~fell).any(axis=0)
    on_ramp = before & (where == "ramp")
    places = rng.uniform([RAMP_WEST + 0.05, RAMP_FOOT], [1.0, LEDGE_SOUTH], (CLIMBS, 2))
    beside = np.stack([rng.uniform(RAMP_WEST, RAMP_WEST + EDGE, CLIMBS), places[:, 1]], axis=1)
    return {
        "completed": float(arrived.mean()),
        "falls": float((before & fell).any(axis=0).mean()),
        "wall": float(1 - states[1:, :, 0][on_ramp].mean()) if on_ramp.any() else None,
        "leftward": float((actions(agent, places)[..., 0] < 0).mean()),
        "at_edge": float((actions(agent, beside)[..., 0] < 0).mean()),
        "actions": actions(agent, np.array([MIDDLE]))[0].round(3).tolist(),
    }


def actions(agent: Agent, places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n samples 2"]:
    """Samples of the policy at each place, bound for the ledge straight ahead."""
    ahead = np.stack([places[:, 0], np.full(len(places), LEDGE)], axis=1)
    states, goals = (agent.scale.scaled(jnp.asarray(x)) for x in (places, ahead))
    latents = jax.random.normal(jax.random.key(0), (SAMPLES, 2))

    def sampled(state: jax.Array, goal: jax.Array) -> jax.Array:
        policy = agent.models.policy(state, goal)
        return jnp.clip(jax.vmap(lambda z: decode(policy, z))(latents), -1, 1)

    return np.asarray(jax.jit(jax.vmap(sampled))(states, goals))


def draw(folders: dict[str, list[Path]]) -> None:
    """Measures the agents that this machine has, then draws from the results alone."""
    found: dict[str, list[dict[str, Measures]]] = {}
    for setting, runs in folders.items():
        for folder in runs:
            run = folder / "run"
            file = folder / "climbs.json"
            if not file.exists() and run.exists():
                kept = sorted(run.glob("checkpoints/[0-9]*"))
                said = {str(int(c.name)): climbs(everystate.load(c)) for c in kept}
                file.write_text(json.dumps(said) + "\n")
            found.setdefault(setting, []).append(json.loads(file.read_text()))
    last = {setting: [run[max(run, key=int)] for run in runs] for setting, runs in found.items()}
    names = ("completed", "falls", "wall", "leftward", "at_edge")
    said = {
        setting: {n: summary([m[n] for m in runs if m[n] is not None]) for n in names}
        for setting, runs in last.items()
    }
    results = seeds.results_of(NAME)
    (results / "climbs.json").write_text(json.dumps(said, indent=1) + "\n")
    growth(found, names).savefig(results / "climbs.png", dpi=150)
    clouds(last).savefig(results / "actions.png", dpi=150)


@styled
def growth(found: dict[str, list[dict[str, Measures]]], names: tuple[str, ...]) -> Figure:
    """A panel for each measure over epochs: seeds thin, their median thick."""
    figure = Figure(figsize=(WIDTH, 4.6))
    titles = ("climbs completed", "falls per climb", "distance to the wall [m]")
    titles += ("leftward actions", "leftward actions at the edge")
    axes = figure.subplots(2, 3).ravel()
    axes[-1].remove()
    for ax, name, title in zip(axes[:-1], names, titles, strict=True):
        for colour, (setting, runs) in zip(COLOURS, found.items(), strict=False):
            epochs = sorted(map(int, set.intersection(*map(set, runs))))
            curves = np.array([[run[str(e)][name] for e in epochs] for run in runs], dtype=float)
            ax.plot(epochs, curves.T, "-", color=colour, linewidth=0.7, alpha=0.5)
            middle = np.nanmedian(curves, axis=0)
            ax.plot(epochs, middle, "-", color=colour, linewidth=2, label=setting)
        ax.set(title=title, xlabel="epoch", ylim=(0, None))
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


@styled
def clouds(last: dict[str, list[Measures]]) -> Figure:
    """The policy's actions half way up, of all seeds together: left is away from the wall."""
    figure = Figure(figsize=(WIDTH, 2.2))
    row = figure.subplots(1, len(last), sharey=True, squeeze=False)[0]
    for ax, colour, (setting, runs) in zip(row, COLOURS, last.items(), strict=False):
        x, y = np.concatenate([run["actions"] for run in runs]).T
        ax.plot(x, y, ".", color=colour, markersize=2, alpha=0.5)
        ax.axvline(0, color="grey", linewidth=0.7)
        ax.set(title=setting, xlabel="east", xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    row[0].set_ylabel("north")
    return figure


if __name__ == "__main__":
    seeds.main(
        "ramp-pointmass", SETTINGS, draw, description=str(__doc__).splitlines()[0], name=NAME
    )
