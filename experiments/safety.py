"""Does the pessimal policy avoid the edge of the ramp (Fig. 3, middle)?

    python experiments/safety.py

The worst of the N imagined returns against their mean, N being that of `quick` or 20 as in the
paper, a percentile between them, and sensor noise, on the Ramp Pointmass for 100 epochs, as
`safety.toml` has it; runs and summary are in results/safety. Of every agent kept on the way,
`climbs.json` beside a run's other results says how it climbs; `climbs.json` and pictures compare
the conditions. `safety_grid.py` says what there is to learn.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import safety_figures
import seeds
from jaxtyping import Float

import everystate
from everystate import Agent
from everystate.envs import make
from everystate.envs.ramp_pointmass import LEDGE_SOUTH, RAMP_FOOT, RAMP_WEST, region
from everystate.evaluation import raw
from everystate.evaluation.aggregate import summary
from everystate.learning.flows import decode
from everystate.learning.planning import Planning
from everystate.studies import Study, read

NAME = "safety"
GOALS = {"ahead": None, "west": 0.0}
"""Their x, None being that of the start; the short way to the west leads along the edges."""
LEDGE = 0.85  # their y
CLIMBS, STEPS, SAMPLES = 200, 60, 200
TRACKS, DOTS = 12, 100  # of climbs and samples, that pictures show
EDGE = 0.1  # m: an action moves it so far, and its noise as much as 0.06 further
MIDDLE = (0.75, 0.0)  # half way up: where the paper's figure shows the actions
ACROSS = (0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8)  # x, over the edge
ALONG = (-0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.4)  # y, over which V is averaged at each of these
SEARCH = Planning(horizon=1, rollouts=20, checks=20)
"""The policy, corrected by one step of d and V."""
NUMBERS = {
    "falls": "falls, % of climbs",
    "completed": "climbs completed, %",
    "at_edge": "leftward actions within 0.1 m of the edge, %",
    "leftward": "leftward actions anywhere on the ramp, %",
    "wall": "distance to the wall while climbing, m",
}
Measures = dict[str, Any]
Places = Float[np.ndarray, "n 2"]


def climbs(agent: Agent) -> dict[str, Measures]:
    """What `walked` says of its climbs to the goals of each kind, and what it does on the ramp.

    `leftward` is the probability of an action away from the wall, over places on the ramp;
    `at_edge` the same where such an action can make it fall; `across` V on both sides of the edge.
    """
    places, beside, edge = on_ramp()
    said: dict[str, Measures] = {}
    for name, x in GOALS.items():
        along = agent.value(edge, bound_for(edge, x)).reshape(len(ACROSS), len(ALONG))
        said[name] = walked(lambda here, goals: agent.act(here, goals), x) | {
            "leftward": float((actions(agent, places, x)[..., 0] < 0).mean()),
            "at_edge": float((actions(agent, beside, x)[..., 0] < 0).mean()),
            "across": rounded(along.mean(axis=1)),
            "actions": rounded(actions(agent, np.array([MIDDLE]), x)[0, :DOTS]),
        }
    return said


def searched(agent: Agent) -> Measures:
    """Climbs to the west where not the policy decides, but V a step ahead: what is the policy's."""
    walk = walked(lambda here, goals: agent.act(here, goals, plan=SEARCH), GOALS["west"])
    return {name: walk[name] for name in ("completed", "falls", "wall")}


def on_ramp() -> tuple[Places, Places, Places]:
    """Places all over the ramp, beside its edge, and on both sides of it."""
    rng = np.random.default_rng(1)
    places = rng.uniform([RAMP_WEST + EDGE / 2, RAMP_FOOT], [1, LEDGE_SOUTH], (CLIMBS, 2))
    beside = np.stack([rng.uniform(RAMP_WEST, RAMP_WEST + EDGE, CLIMBS), places[:, 1]], axis=1)
    return places, beside, np.array([(x, y) for x in ACROSS for y in ALONG])


def walked(
    act: Callable[[Places, Places], Places], goal_x: float | None, **noise: float
) -> Measures:
    """Climbs from the ramp's foot to goals at this x, or straight ahead, under the body's noise.

    `completed` of them stand on the ledge at some step and `falls` of them fall before that; `wall`
    is how far from the east wall they are on the ramp, in metres; `tracks` are the first, up to
    where one or the other comes, and `fallen` says whose end is a fall.

    Args:
        act: what is done at places on the way to goals.
        goal_x: as in `GOALS`.
        noise: fields of the body, where it is to suffer another.
    """
    across = np.random.default_rng(0).uniform(RAMP_WEST + EDGE / 2, 1 - EDGE / 2, CLIMBS)
    foot = np.stack([across, np.full(CLIMBS, RAMP_FOOT)], axis=1)
    goals = bound_for(foot, goal_x)
    env = make("ramp-pointmass", CLIMBS, 0, **noise)
    env.set_observations(foot)
    states, over = [foot.astype(np.float32)], np.zeros(CLIMBS, dtype=bool)
    while len(states) <= STEPS and not over.all():
        states.append(env.step(act(states[-1], goals))[0])
        over |= (region(states[-1]) == "ledge") | env.falls(states[-2], states[-1])
    xy = np.stack(states)
    where, fell = region(xy[1:]), env.falls(xy[:-1], xy[1:])
    decided = (where == "ledge") | fell
    before = np.cumsum(decided, axis=0) - decided == 0  # up to the step that decides it
    climbing = before & (where == "ramp")
    fallen = (before & fell).any(axis=0)
    ends = before.sum(axis=0) + 1
    return {
        "completed": float((before & (where == "ledge") & ~fell).any(axis=0).mean()),
        "falls": float(fallen.mean()),
        "wall": float(1 - xy[1:, :, 0][climbing].mean()) if climbing.any() else None,
        "tracks": [rounded(xy[: ends[i], i]) for i in range(TRACKS)],
        "fallen": fallen[:TRACKS].tolist(),
    }


def bound_for(places: Places, x: float | None) -> Places:
    """A goal on the ledge for each place: at this x, or straight ahead."""
    to = np.full((len(places), 2), LEDGE)
    to[:, 0] = places[:, 0] if x is None else x
    return to


def actions(agent: Agent, places: Places, x: float | None) -> Float[np.ndarray, "n samples 2"]:
    """Samples of the policy at each place, bound for the ledge."""
    latents = jax.random.normal(jax.random.key(0), (SAMPLES, 2))

    def sampled(state: jax.Array, goal: jax.Array) -> jax.Array:
        policy = agent.models.policies[0](state, goal)
        return jnp.clip(jax.vmap(lambda z: decode(policy, z))(latents), -1, 1)

    pairs = (agent.scale.scaled(jnp.asarray(y)) for y in (places, bound_for(places, x)))
    return np.asarray(jax.jit(jax.vmap(sampled))(*pairs))


def rounded(values: Float[np.ndarray, "*n"]) -> list[Any]:
    """To two decimals, for a file."""
    return values.astype(float).round(2).tolist()


def draw(study: Study, results: Path) -> None:
    """Measures the agents that this machine has, then draws from the results alone."""
    for folder in (f for runs in seeds.summarised(study, results).values() for f in runs):
        if not (folder / "climbs.json").exists() and (folder / "run").exists():
            raw.write(folder / "climbs.json", {"epochs": measured(folder / "run")})
    found = by_epoch(results)
    last = at_end(found)
    said = summaries(last)
    raw.write(results / "climbs.json", said, replace=True)
    safety_figures.growth(found).savefig(results / "climbs.png", dpi=150)
    safety_figures.clouds(last).savefig(results / "actions.png", dpi=150)
    safety_figures.falls(last).savefig(results / "falls.png", dpi=150)


def measured(run: Path) -> dict[str, dict[str, Measures]]:
    """What `climbs` says of every agent kept, by epoch, and `searched` of the last one."""
    kept = {str(int(c.name)): c for c in sorted(run.glob("checkpoints/[0-9]*"))}
    said = {epoch: climbs(everystate.load(checkpoint)) for epoch, checkpoint in kept.items()}
    last = max(kept, key=int)
    said[last]["searched"] = searched(everystate.load(kept[last]))
    return said


def by_epoch(results: Path) -> dict[str, list[dict[str, Any]]]:
    """What was measured of every seed of each condition, by epoch."""
    conditions = read(seeds.ROOT / "experiments" / f"{NAME}.toml").conditions
    files = {name: sorted(results.glob(f"{name}/seed*/climbs.json")) for name in conditions}
    return {name: [epochs(file) for file in found] for name, found in files.items() if found}


def epochs(file: Path) -> dict[str, Any]:
    """`measured` of a run, from its file; older files have no header around it."""
    content = json.loads(file.read_text())
    return content.get("epochs", content)


def at_end(found: dict[str, list[dict[str, Any]]]) -> dict[str, list[Measures]]:
    """The same of the last epoch alone."""
    return {name: [run[max(run, key=int)] for run in runs] for name, runs in found.items()}


def summaries(last: dict[str, list[Measures]]) -> dict[str, Any]:
    """Every number over seeds: by condition, by where the goal is or `searched`."""
    said: dict[str, Any] = {}
    for name, runs in last.items():
        numbers = {kind: [n for n in NUMBERS if n in runs[0][kind]] for kind in runs[0]}
        said[name] = {
            kind: {n: summary([r[kind][n] for r in runs if r[kind][n] is not None]) for n in of}
            for kind, of in numbers.items()
        }
    return said


if __name__ == "__main__":
    seeds.main(NAME, draw, description=str(__doc__))
