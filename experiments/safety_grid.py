"""Is the worst of N outcomes safer than their mean on the ramp if nothing has to be learned?

    python experiments/safety_grid.py

Solves eq. 3 for the body itself, on a grid of places and actions, outcomes drawn from MuJoCo: no
network, no learned model. A step costs 1 until the goal is within 0.1 m; as in the algorithm, an
action is chosen by the worst of its outcomes, and what it is worth is their mean. Writes
`results/safety/grid.json`, measured as `safety.py` does, and `grid.png`, beside what agents
learned.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import safety
import safety_figures
import seeds
from jaxtyping import Float, Int
from safety import GOALS, LEDGE, Measures, Places, rounded
from scipy.sparse import csr_array
from scipy.special import comb

from everystate.envs import make
from everystate.envs.ramp_pointmass import ARENA
from everystate.evaluation import raw

# Masses come to rest on either side of an edge and never over it, 0.45 < x < 0.5, so that no value
# between grid points is one between the ramp and the floor.
CELL = 0.05
SIDE = round(2 * ARENA / CELL) + 1
OUTCOMES, ROUNDS, SWEEPS = 48, 50, 20
NOISES: dict[str, dict[str, float]] = {
    "noise as it is": {},
    "more noise": {"noise_sigma": 0.6, "noise_bound": 1.0},
}
COUNTS = {"mean": 1, "worst of 8": 8, "worst of 20": 20}
AHEAD = np.arange(0.5, 1.01, 0.1)  # x of the goals ahead: each place goes by the nearest
_LINE = np.linspace(-1, 1, 5)
ACTIONS = np.stack(np.meshgrid(_LINE, _LINE), axis=-1).reshape(-1, 2)


@dataclass(frozen=True)
class Solution:
    """For goals at these x on the ledge: minus the steps to them, and which action is best."""

    x: Float[np.ndarray, " goals"]
    values: Float[np.ndarray, "goals places"]
    best: Int[np.ndarray, "goals places"]

    def act(self, here: Places, goals: Places) -> Places:
        """The best action at the nearest place to the nearest goal."""
        return ACTIONS[self.best[self._which(goals), nearest(here)]].astype(np.float32)

    def value(self, here: Places, goals: Places) -> Float[np.ndarray, " n"]:
        """V(s, g), as nearly."""
        return self.values[self._which(goals), nearest(here)]

    def _which(self, goals: Places) -> Int[np.ndarray, " n"]:
        return np.abs(goals[:, :1] - self.x).argmin(axis=1)


def places() -> Places:
    """The grid, x slowest."""
    line = np.linspace(-ARENA, ARENA, SIDE)
    return np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)


def nearest(xy: Places) -> Int[np.ndarray, " n"]:
    """Which place of the grid lies next to each of these."""
    x, y = np.rint((xy.T + ARENA) / CELL).astype(int)
    return x * SIDE + y


def outcomes(**noise: float) -> csr_array:
    """A row for each draw of each action at each place: the weights of places at what comes."""
    grid = places()
    env = make("ramp-pointmass", len(grid), 0, **noise)
    came = []
    for action in np.repeat(ACTIONS, OUTCOMES, axis=0):
        env.set_observations(grid)
        came.append(env.step(np.tile(action, (len(grid), 1)))[0])
    at = (np.stack(came, axis=1).reshape(-1, 2).astype(np.float64) + ARENA) / CELL
    low = np.clip(at.astype(int), 0, SIDE - 2)
    (x, y), (i, j) = np.clip(at - low, 0, 1).T, low.T
    weights = np.stack([(1 - x) * (1 - y), (1 - x) * y, x * (1 - y), x * y], axis=1)
    corners = (i * SIDE + j)[:, None] + np.array([0, 1, SIDE, SIDE + 1])
    ends = np.arange(0, weights.size + 1, 4)
    return csr_array((weights.ravel(), corners.ravel(), ends), shape=(len(at), len(grid)))


def worst_of(count: int) -> Float[np.ndarray, " outcomes"]:
    """Weights of sorted outcomes whose sum is the worst of `count`, averaged over all choices."""
    return np.asarray(comb(np.arange(OUTCOMES)[::-1], count - 1) / comb(OUTCOMES, count))


def solve(after: csr_array, x: Float[np.ndarray, " goals"], count: int) -> Solution:
    """The action that is best for the worst of `count` outcomes, and the mean that it earns."""
    solved = [_solve(after, np.array([east, LEDGE]), count) for east in x]
    return Solution(x, *map(np.stack, zip(*solved, strict=True)))


def _solve(after: csr_array, goal: Float[np.ndarray, "2"], count: int) -> tuple[Any, Any]:
    grid = places()
    near = np.linalg.norm(grid - goal, axis=1) <= 0.1
    values, best = np.zeros(len(grid)), np.zeros(len(grid), dtype=int)
    for _ in range(ROUNDS):
        returns = (after @ np.where(near, 0, values - 1)).reshape(len(grid), -1, OUTCOMES)
        best = (np.sort(returns, axis=-1) @ worst_of(count)).argmax(axis=1)
        draws = (np.arange(len(grid)) * len(ACTIONS) + best)[:, None] * OUTCOMES
        chosen = after[(draws + np.arange(OUTCOMES)).ravel()]
        for _ in range(SWEEPS):
            came = (chosen @ np.where(near, 0, values - 1)).reshape(-1, OUTCOMES)
            values = came.mean(axis=1)
    return values, best


def measures(after: csr_array, count: int, **noise: float) -> dict[str, Measures]:
    """As `safety.climbs` has it; at the edge, the share of places whose best action is leftward."""
    _, beside, edge = safety.on_ramp()
    said: dict[str, Measures] = {}
    for name, x in GOALS.items():
        solution = solve(after, AHEAD if x is None else np.array([x]), count)
        left = solution.act(beside, safety.bound_for(beside, x))[:, 0] < 0
        along = solution.value(edge, safety.bound_for(edge, x)).reshape(len(safety.ACROSS), -1)
        said[name] = safety.walked(solution.act, x, **noise) | {
            "at_edge": float(left.mean()),
            "across": rounded(along.mean(axis=1)),
        }
    return said


def main() -> None:
    """Solves, measures and draws."""
    said: dict[str, Any] = {"x": safety.ACROSS}
    for name, noise in NOISES.items():
        after = outcomes(**noise)
        said[name] = {score: measures(after, n, **noise) for score, n in COUNTS.items()}
    results = seeds.RESULTS / safety.NAME
    raw.write(results / "grid.json", said, replace=True)
    learned = safety.at_end(safety.by_epoch(results))
    safety_figures.grid(said, learned).savefig(results / "grid.png", dpi=150)


if __name__ == "__main__":
    main()
