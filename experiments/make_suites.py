"""Makes the goal suites that `everystate evaluate` uses: python experiments/make_suites.py BODY.

Run again, it writes the same file; the suites in the package were made by it.
"""

import sys
from pathlib import Path

import ant_controllers as ants
import numpy as np
from cartpole_controllers import pump, regulator
from jaxtyping import Bool, Float
from scipy.stats import qmc

from everystate.envs import make
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
from everystate.evaluation import metrics, suites

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
    """Standard deviation of x, y, z over the area of the arena."""
    axis = np.linspace(-ARENA, ARENA, 4001)
    axis = (axis[1:] + axis[:-1]) / 2
    xy = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    return np.array([*xy.std(axis=0), height(xy).std()]).round(4)


def ramp_pointmass(seed: int = 0) -> suites.Suite:
    """The suite of the Ramp Pointmass."""
    rng = np.random.default_rng(seed)
    goals = ramp_places({"floor": 80, "ramp": 60, "ledge": 60}, rng, safe=True)
    starts = ramp_places({"floor": 120, "ramp": 40, "ledge": 40}, rng, safe=False)
    scored, sigma = make("ramp-pointmass", 1, 0).scored, ramp_sigma()
    starts = starts[rng.permutation(len(starts))]

    def apart() -> Bool[np.ndarray, " n"]:
        """A body that starts at its goal would have reached it without doing anything."""
        return metrics.distances(scored(starts)[None], scored(goals), sigma)[0] > 1.0

    while not apart().all():
        first = rng.choice(np.flatnonzero(~apart()))
        second = rng.integers(len(starts))
        good = apart().sum()
        starts[[first, second]] = starts[[second, first]]
        if apart().sum() < good:
            starts[[first, second]] = starts[[second, first]]
    return suites.Suite(
        body="ramp-pointmass",
        notes=RAMP_NOTES,
        seed=seed,
        components=("x", "y", "z"),
        sigma=sigma,
        angular=(),
        position=("x", "y"),
        starts=starts,
        goals=goals,
        # From the far end of the floor round the ramp's foot to the far end of the ledge: about 60.
        horizons=np.full(len(goals), 120),
    )


CARTPOLE_NOTES = (
    "200 goals: 50 hanging and 50 upright, all at rest, evenly spread over 2.4 m of the rail, where"
    " an agent can stay; and 100 moving ones, states that controllers written by hand and random"
    " actions led to, each the farthest from all before it, which it can only pass: read `any`."
    " Half of the starts are at rest and hanging, half in motion. sigma is the standard"
    " deviation over the states visited."
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


def cartpole(seed: int = 0) -> suites.Suite:
    """The suite of the cartpole."""
    rng = np.random.default_rng(seed)
    visited = cartpole_visited(rng)
    sigma = visited.std(axis=0).round(4)
    places = qmc.scale(qmc.Halton(1, rng=rng).random(100), -1.2, 1.2)
    rests = np.repeat([[-1.0, 0, 0, 0], [1.0, 0, 0, 0]], 50, axis=0)
    hanging, upright = np.split(np.concatenate([places, rests], axis=1), 2)
    inner = visited[(np.abs(visited) < [1.5, np.inf, np.inf, 3.0, 10.0]).all(axis=1)]
    moving = inner[(np.abs(inner[:, 3]) > 0.5) | (np.abs(inner[:, 4]) > 1)]
    moving = moving[suites.spread_out(moving / sigma, 100)]
    goals = np.concatenate([hanging, moving, upright])
    rest = np.stack([rng.uniform(-1.2, 1.2, 100), *np.repeat([[-1.0], [0], [0], [0]], 100, axis=1)])
    starts = np.concatenate([rest.T, inner[rng.choice(len(inner), 100, replace=False)]])
    starts = starts[rng.permutation(200)]
    while (near := metrics.distances(starts[None], goals, sigma)[0] <= 1.0).any():
        one, other = rng.choice(np.flatnonzero(near)), rng.integers(200)
        starts[[one, other]] = starts[[other, one]]
    names = make("cartpole", 1, 0).state_names
    return suites.Suite(
        body="cartpole",
        notes=CARTPOLE_NOTES,
        seed=seed,
        components=names,
        sigma=sigma,
        angular=(),
        position=names[:3],
        starts=starts.round(4),
        goals=goals.round(4),
        # Controllers written by hand swing up and come to rest in about 100.
        horizons=np.full(len(goals), 200),
    )


ANT_NOTES = (
    "500 goals: 250 at rest in poses that controllers written by hand came to, and 250 in motion,"
    " visited by random actions, random gaits and on the way to such poses; of each the farthest"
    " from all before it, among those with no component in the outer 1 %. Half of the ants set out"
    " upside down. A goal in motion can only be passed: read `any`. sigma is the standard deviation"
    " over the states visited."
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


def ant(seed: int = 0) -> suites.Suite:
    """The suite of the ant."""
    rng = np.random.default_rng(seed)
    env = make("ant", 1, 0)
    visited, rested = ant_visited(rng)
    sigma = visited.std(axis=0).round(4)
    low, high = np.percentile(visited, [1, 99], axis=0)
    inner = visited[((visited >= low) & (visited <= high)).all(axis=1)]
    moving = inner[env.regions(inner) == "moving"]
    moving = moving[suites.spread_out(moving / sigma, 250)]
    goals = np.concatenate([rested[suites.spread_out(rested / sigma, 250)], moving])
    starts = np.concatenate([pool[rng.choice(len(pool), 250)] for pool in (rested, inner)])
    return suites.Suite(
        body="ant",
        notes=ANT_NOTES,
        seed=seed,
        components=env.state_names,
        sigma=sigma,
        angular=(),
        position=env.state_names[:15],
        starts=starts[rng.permutation(500)].round(4),
        goals=goals.round(4),
        horizons=np.full(500, 100),  # 5 s
    )


MAKERS = {"ramp-pointmass": ramp_pointmass, "cartpole": cartpole, "ant": ant}


def main(bodies: list[str], folder: Path = suites.FOLDER) -> None:
    """Writes one file per body."""
    for body in bodies or sorted(MAKERS):
        path = folder / f"{body}.json"
        path.write_text(suites.to_json(MAKERS[body]()))
        print(path)


if __name__ == "__main__":
    main(sys.argv[1:])
