"""Suites of states that a body can stay in: `rest`, told by the end of a task.

Used by `make_suites.py`. What sigma is measured on never changes with the split's seed.
"""

import ant_controllers as ants
import numpy as np
from cartpole_controllers import pump, regulator
from jaxtyping import Bool, Float
from scipy.stats import qmc

from everystate.envs import BodyVectorEnv, Physics, make
from everystate.envs.ramp_pointmass import (
    ARENA,
    LEDGE_SOUTH,
    RADIUS,
    RAMP_FOOT,
    RAMP_WEST,
    height,
    region,
    set_down,
)
from everystate.evaluation import metrics
from everystate.evaluation.playing import spread_out
from everystate.evaluation.suite import Suite
from everystate.evaluation.suites import Split

SEEDS: dict[Split, int] = {"report": 0, "tune": 1}
_REFERENCE = 0
"""Seed of the states that sigma is measured on."""
DECIMALS = 6


def rounded(physics: list[Physics]) -> tuple[Physics, ...]:
    """As it is written: tasks begin there, so nothing is lost by it."""
    return tuple({n: np.round(x, DECIMALS).tolist() for n, x in one.items()} for one in physics)


def suite(
    env: BodyVectorEnv,
    split: Split,
    notes: str,
    sigma: Float[np.ndarray, " scored"],
    position: tuple[str, ...],
    starts: Float[np.ndarray, "tasks state"],
    goals: Float[np.ndarray, "tasks state"],
    horizon: int,
    components: tuple[str, ...] | None = None,
) -> Suite:
    """A `rest` suite, its starts taken to physics."""
    bodies = make(env.name, len(starts), 0)
    bodies.set_observations(starts)
    return Suite(
        body=env.name,
        name="rest",
        split=split,
        notes=notes,
        seed=SEEDS[split],
        components=components or tuple(env.state_names),
        sigma=sigma,
        angular=(),
        position=position,
        velocity=tuple(
            name
            for name, unit in zip(env.state_names, env.state_units, strict=True)
            if unit.endswith("/s")
        ),
        starts=rounded(bodies.get_physics()),
        goals=goals,
        weights=np.ones((len(goals), len(sigma))),
        kinds=tuple(env.regions(goals).tolist()),
        k=np.zeros(len(goals), dtype=np.int64),
        horizons=np.full(len(goals), horizon),
    )


def apart(
    env: BodyVectorEnv, starts: np.ndarray, goals: np.ndarray, sigma: np.ndarray
) -> Bool[np.ndarray, " tasks"]:
    """A body that starts at its goal would have reached it without doing anything."""
    found = metrics.differences(env.scored(starts)[None], env.scored(goals), sigma)
    return found[0].max(axis=-1) > 1.0


def swapped_apart(
    env: BodyVectorEnv,
    starts: np.ndarray,
    goals: np.ndarray,
    sigma: np.ndarray,
    rng: np.random.Generator,
) -> Float[np.ndarray, "tasks state"]:
    """The starts in an order in which none lies within 1 sigma of its goal."""
    starts = starts[rng.permutation(len(starts))]
    while not (fine := apart(env, starts, goals, sigma)).all():
        one, other = rng.choice(np.flatnonzero(~fine)), rng.integers(len(starts))
        starts[[one, other]] = starts[[other, one]]
        if apart(env, starts, goals, sigma).sum() < fine.sum():
            starts[[one, other]] = starts[[other, one]]
    return starts


RAMP_NOTES = (
    "200 goals (80 on the floor, 60 on the ramp, 60 on the ledge), evenly spread within their"
    " region; 120 starts on the floor, 40 on the ramp, 40 on the ledge, in every mix with the goals"
    " and never within eps = 1 of their own. Goals stand off by a ball's diameter (0.1 m) from the"
    " edges one can fall off - the west side of the ramp, the south side of the ledge - because"
    " under the body's action noise nobody can stay on an edge. Scored are x, y and the derived z:"
    " standing below the ledge is not reaching it. sigma is the standard deviation over places"
    " uniform in the arena."
)


def ramp_rests(xy: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """Where a ball can be: nothing to set down, and one idle step leaves it but for the slope."""
    env = make("ramp-pointmass", len(xy), 0, noise_sigma=0.0)
    env.set_observations(xy)
    after = env.step(np.zeros((len(xy), 2)))[0]
    return (set_down(xy) == xy).all(axis=1) & (np.abs(after - xy).max(axis=1) < 0.01)


def ramp_safe(xy: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """At least a ball's diameter from the edges one can fall off."""
    x, y = xy[:, 0], xy[:, 1]
    off_ledge = (y >= LEDGE_SOUTH) & (y < LEDGE_SOUTH + 2 * RADIUS)
    off_ramp = (x >= RAMP_WEST) & (x < RAMP_WEST + 2 * RADIUS) & (y > RAMP_FOOT)
    return ~(off_ramp | off_ledge)


def ramp_places(
    counts: dict[str, int], rng: np.random.Generator, *, safe: bool
) -> Float[np.ndarray, "n 2"]:
    """The first places of a low-discrepancy sequence in each region: evenly spread."""
    xy = qmc.scale(qmc.Halton(2, rng=rng).random(4000), [-ARENA] * 2, [ARENA] * 2).round(4)
    xy = xy[ramp_rests(xy) & (ramp_safe(xy) | (not safe))]
    where = region(xy)
    return np.concatenate([xy[where == name][:count] for name, count in counts.items()])


def ramp_sigma() -> Float[np.ndarray, " 3"]:
    """The frozen reference: standard deviation of x, y, z over the area of the arena."""
    axis = np.linspace(-ARENA, ARENA, 4001)
    axis = (axis[1:] + axis[:-1]) / 2
    xy = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    return np.array([*xy.std(axis=0), height(xy).std()]).round(4)


def ramp_pointmass(split: Split) -> Suite:
    """The Ramp Pointmass."""
    rng, env, sigma = (
        np.random.default_rng(SEEDS[split]),
        make("ramp-pointmass", 1, 0),
        ramp_sigma(),
    )
    goals = ramp_places({"floor": 80, "ramp": 60, "ledge": 60}, rng, safe=True)
    starts = ramp_places({"floor": 120, "ramp": 40, "ledge": 40}, rng, safe=False)
    starts = swapped_apart(env, starts, goals, sigma, rng)
    # From the far end of the floor round the ramp's foot to the far end of the ledge: about 60.
    return suite(env, split, RAMP_NOTES, sigma, ("x", "y"), starts, goals, 120, ("x", "y", "z"))


CARTPOLE_NOTES = (
    "200 goals at rest, evenly spread over 2.4 m of the rail: 100 hanging and 100 upright. Half of"
    " the starts are at rest and hanging, half in motion, as controllers written by hand and random"
    " actions led to; none within 1 sigma of its goal. sigma is the standard deviation over the"
    " states that those visited."
)


def cartpole_visited(rng: np.random.Generator, num: int = 60) -> Float[np.ndarray, "n 5"]:
    """States on the way up, upright, spinning, coming to rest, and under random actions."""
    up, down, env = regulator(0.0), regulator(np.pi), make("cartpole", num, 0)
    states, _ = env.reset(seed=int(rng.integers(2**31)))
    visited = []
    for _ in range(12):
        place, speed = rng.uniform(-1.2, 1.2, num), rng.uniform(0, 8, num)
        what = rng.integers(4, size=num)
        for _ in range(100):
            now = states.astype(float)
            caught = (now[:, 1] > 0.9) & (np.abs(now[:, 4]) < 3.5)
            choices = [
                np.where(caught, up(now, place), pump(now, place, 0.0)),
                pump(now, place, speed),
                down(now, place),
                rng.uniform(-1, 1, num),
            ]
            actions = np.clip(np.choose(what, choices), -1, 1)
            states = env.step(actions[:, None])[0]
            visited.append(states)
    return np.concatenate(visited).astype(float)


def cartpole(split: Split) -> Suite:
    """The cartpole."""
    rng, env = np.random.default_rng(SEEDS[split]), make("cartpole", 1, 0)
    sigma = cartpole_sigma()
    visited = cartpole_visited(rng)
    places = qmc.scale(qmc.Halton(1, rng=rng).random(200), -1.2, 1.2)
    rests = np.repeat([[-1.0, 0, 0, 0], [1.0, 0, 0, 0]], 100, axis=0)
    goals = np.concatenate([places, rests], axis=1).round(4)
    inner = visited[(np.abs(visited) < [1.5, np.inf, np.inf, 3.0, 10.0]).all(axis=1)]
    hanging = np.repeat([[0.0, -1.0, 0.0, 0.0, 0.0]], 100, axis=0)
    hanging[:, 0] = rng.uniform(-1.2, 1.2, 100)
    starts = np.concatenate([hanging, inner[rng.choice(len(inner), 100, replace=False)]])
    starts = swapped_apart(env, starts, goals, sigma, rng)
    # Controllers written by hand swing up and come to rest in about 100.
    return suite(env, split, CARTPOLE_NOTES, sigma, env.state_names[:3], starts, goals, 200)


def cartpole_sigma() -> Float[np.ndarray, " 5"]:
    """The frozen reference: of the states visited from one seed."""
    return cartpole_visited(np.random.default_rng(_REFERENCE)).std(axis=0).round(4)


ANT_NOTES = (
    "200 goals at rest, in poses that controllers written by hand came to, 100 upright and 100"
    " upside down, each the farthest from all before it. Half of the starts are at rest, half in"
    " motion, visited by random actions, random gaits and on the way to such poses; half of these"
    " ants set out upside down. sigma is the standard deviation over the states visited."
)


def ant_visited(
    rng: np.random.Generator, num: int = 200
) -> tuple[Float[np.ndarray, "n 29"], Float[np.ndarray, "m 29"]]:
    """States on the way, and those in which ants had come to rest."""
    env = make("ant", num, 0)
    states, _ = env.reset(seed=int(rng.integers(2**31)))
    over = rng.random(num) < 0.5
    states[over, 4:7] *= -1  # the y axis: half a turn about the x axis
    env.set_observations(states)
    visited, rested = [], []
    for done in ants.play(env, states, rng, rounds=12, steps=60):
        last = done.next_observations[-1]
        visited.append(done.next_observations.reshape(-1, last.shape[1]))
        rested.append(last[done.posing & (env.regions(last) != "moving")])
    return np.concatenate(visited).astype(float), np.concatenate(rested).astype(float)


def ant(split: Split) -> Suite:
    """The ant."""
    rng, env = np.random.default_rng(SEEDS[split]), make("ant", 1, 0)
    sigma = ant_sigma()
    visited, rested = ant_visited(rng)
    where = env.regions(rested)
    pools = [rested[where == way] for way in ("upright", "upside down")]
    goals = np.concatenate([pool[spread_out(pool / sigma, 100)] for pool in pools]).round(4)
    starts = np.concatenate([pool[rng.choice(len(pool), 100)] for pool in (rested, visited)])
    starts = swapped_apart(env, starts, goals, sigma, rng).round(4)
    return suite(env, split, ANT_NOTES, sigma, env.state_names[:15], starts, goals, 100)  # 5 s


def ant_sigma() -> Float[np.ndarray, " 29"]:
    """The frozen reference: of the states visited from one seed."""
    return ant_visited(np.random.default_rng(_REFERENCE))[0].std(axis=0).round(4)


MAKERS = {"ramp-pointmass": ramp_pointmass, "cartpole": cartpole, "ant": ant}
