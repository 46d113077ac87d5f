"""What an ant's run has found by itself: python tools/ant_coverage.py RUN [--plan].

To `RUN/coverage`: `coverage.png`, the poses and velocities that bodies came through, early
and late in training; and `gallery.png`, the six most different of the ways that the agent went to
200 goals of the suite, beginning with the one most unlike the mean. `found.npz` has what both show.
"""

import argparse
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

import everystate
from everystate import Agent
from everystate.agent import keep_compiled_programs
from everystate.envs import make
from everystate.evaluation import rollout, suites
from everystate.skills.ant_rules import up
from everystate.training.collection import read_samples
from everystate.viewing import images, plots

PANELS, WAYS, FRAMES, GOALS, STEPS = 4, 6, 5, 200, 100
States = Float[np.ndarray, "n 29"]


def poses(states: States) -> Float[np.ndarray, "n 2"]:
    """How upright the torso is, from -1 to 1, and its height in metres."""
    return np.stack([up(states), states[:, 0]], axis=1)


def velocities(states: States) -> Float[np.ndarray, "n 2"]:
    """Along the torso's own x axis in m/s, and about the vertical in rad/s."""
    forward = (states[:, 15:18] * states[:, 1:4]).sum(axis=1)
    return np.stack([forward, states[:, 20]], axis=1)


def early_and_late(run: Path) -> tuple[list[int], list[States]]:
    """Epochs in equal ratios from the first to the last that has samples, and what was visited."""
    kept = {int(path.stem): path for path in sorted((run / "samples").glob("*.npz"))}
    wanted = np.geomspace(min(kept), max(kept), PANELS)
    epochs = [min(kept, key=lambda e: abs(e - at)) for at in wanted]
    return epochs, [read_samples(kept[epoch])["next_observations"] for epoch in epochs]


def ways(agent: Agent, plan: bool) -> tuple[Float[np.ndarray, "ways steps 29"], States]:
    """The most different ways to goals, farthest first by their states' means and spreads."""
    suite = suites.load("ant").subset(GOALS)
    env = make("ant", GOALS, 0)
    states = rollout(agent, env, suite.begin(env, 0), suite.goals, STEPS, plan=plan, seed=0)
    scaled = states / env.scaling.spread
    told = np.concatenate([scaled.mean(axis=0), scaled.std(axis=0)], axis=1)
    nearest = np.linalg.norm(told - told.mean(axis=0), axis=1)
    chosen: list[int] = []
    while len(chosen) < WAYS:
        chosen.append(int(nearest.argmax()))
        apart = np.linalg.norm(told - told[chosen[-1]], axis=1)
        nearest = apart if len(chosen) == 1 else np.minimum(nearest, apart)
    return states[:, chosen].swapaxes(0, 1), suite.goals[chosen]


@plots.styled
def coverage(epochs: list[int], visited: list[States]) -> Figure:
    """A column for each epoch: poses above, velocities below."""
    figure = Figure(figsize=(plots.WIDTH, 3.6))
    rows = figure.subplots(2, PANELS, sharex="row", sharey="row")
    for column, (epoch, states) in enumerate(zip(epochs, visited, strict=True)):
        for ax, points in zip(rows[:, column], (poses(states), velocities(states)), strict=True):
            ax.plot(*points.T, ".", markersize=2, alpha=0.5)
        rows[0, column].set(title=f"epoch {epoch}", xlabel="upright")
        rows[1, column].set(xlabel="forward [m/s]")
    rows[0, 0].set_ylabel("height [m]")
    rows[1, 0].set_ylabel("turning [rad/s]")
    return figure


def gallery(states: Float[np.ndarray, "ways steps 29"], goals: States) -> Figure:
    """A row for each way; the green ghost is its goal."""
    env, at = make("ant", 1, 0), np.linspace(0, STEPS, FRAMES).round().astype(int)
    frames = [
        frame
        for way, goal in zip(states, goals, strict=True)
        for frame in env.render_states(way[at], goal, width=400, height=300)
    ]
    titles = [f"{step / 20:g} s" for step in at] * len(states)
    return images.filmstrip(frames, titles, columns=FRAMES)


def main() -> None:
    """Looks into a run."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--plan", action="store_true", help="send it with planning")
    options = parser.parse_args()
    keep_compiled_programs()
    folder = options.run / "coverage"
    folder.mkdir(parents=True, exist_ok=True)
    epochs, visited = early_and_late(options.run)
    states, goals = ways(everystate.load(options.run), options.plan)
    np.savez_compressed(
        folder / "found.npz", epochs=epochs, visited=visited, states=states, goals=goals
    )
    plots.save(coverage(epochs, visited), folder / "coverage.png")
    plots.save(gallery(states, goals), folder / "gallery.png")


if __name__ == "__main__":
    main()
