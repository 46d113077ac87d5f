"""Pictures of a two-dimensional state space: what the agent values, imagines and does, where."""

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from gymnasium.spaces import Box
from jaxtyping import Float, Float32
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from everystate.envs import BodyVectorEnv
from everystate.envs.ramp_pointmass import ARENA, LEDGE_SOUTH, RAMP_FOOT, RAMP_WEST
from everystate.evaluation import Agent
from everystate.viewing.plots import BLACK, GREY, RED, WIDTH, styled

_POINTS = 61  # per axis of a map
_ARROWS = 19

# Lines on the map, as (x, y) of their ends: cliffs cannot be climbed, seams are walked over.
CLIFFS: dict[str, list[tuple[list[float], list[float]]]] = {
    "ramp-pointmass": [
        ([RAMP_WEST, RAMP_WEST, -ARENA], [RAMP_FOOT, LEDGE_SOUTH, LEDGE_SOUTH]),
    ]
}
SEAMS: dict[str, list[tuple[list[float], list[float]]]] = {
    "ramp-pointmass": [
        ([RAMP_WEST, ARENA], [RAMP_FOOT, RAMP_FOOT]),
        ([RAMP_WEST, ARENA], [LEDGE_SOUTH, LEDGE_SOUTH]),
    ]
}


@runtime_checkable
class Explorer(Agent, Protocol):
    """An agent that can also be asked what it imagines."""

    def propose_goals(self, n: int, seed: int = 0) -> Float32[np.ndarray, "n state"]: ...

    def log_density(self, state: Any) -> Any: ...


def drawable(env: BodyVectorEnv) -> bool:
    """Whether the body's whole state is a place on a map."""
    low, high = _bounds(env)
    return low.shape == (2,) and bool(np.isfinite([low, high]).all())


@styled
def value_maps(
    agent: Agent, env: BodyVectorEnv, goals: Mapping[str, Float[np.ndarray, " 2"]]
) -> Figure:
    """-V(s, g) over the states s, for one goal g per panel."""
    xs, ys, states = _grid(env, _POINTS)
    steps = {name: _steps(agent, states, goal) for name, goal in goals.items()}
    longest = max(float(values.max()) for values in steps.values())
    figure = Figure(figsize=(WIDTH, WIDTH / len(goals) + 0.15))
    panels = figure.subplots(1, len(goals), sharey=True, squeeze=False)[0]
    image = None
    for i, (ax, (name, goal)) in enumerate(zip(panels, goals.items(), strict=True)):
        values = steps[name].reshape(_POINTS, _POINTS)
        image = ax.pcolormesh(
            xs, ys, values, cmap="viridis_r", vmin=0, vmax=longest, shading="gouraud"
        )
        ax.contour(xs, ys, values, levels=6, colors="white", linewidths=0.6, alpha=0.8)
        _furnish(ax, env, label_y=i == 0)
        _star(ax, goal)
        ax.set_title(f"goal on the {name}" if len(goals) > 1 else "")
    assert image is not None
    figure.colorbar(image, ax=list(panels), label="steps to the goal, −V", shrink=0.85)
    return figure


@styled
def goal_cloud(
    agent: Explorer,
    env: BodyVectorEnv,
    visited: Float[np.ndarray, "n 2"],
    training_goals: Float[np.ndarray, "m 2"],
    *,
    seed: int = 0,
) -> Figure:
    """Goals the agent proposes to itself, by how dense it thinks its past was there."""
    proposed = agent.propose_goals(400, seed=seed)
    density = np.asarray(agent.log_density(proposed))
    figure = Figure(figsize=(WIDTH, 3.6))
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    left.scatter(*visited.T, s=7, color=GREY, alpha=0.7, linewidths=0)
    left.scatter(*training_goals.T, s=30, marker="x", color=RED, linewidths=1.2)
    left.set_title("visited (dots), goals then (×)")
    # A few goals far out would otherwise take all the colours.
    low, high = np.percentile(density, [5, 95])
    dots = right.scatter(*proposed.T, c=density, cmap="viridis", s=11, vmin=low, vmax=high)
    beyond = f"{100 * _beyond(env, proposed):.0f} % beyond bounds"
    right.set_title(f"{len(proposed)} proposed goals, {beyond}")
    for ax in (left, right):
        _furnish(ax, env, label_y=ax is left)
        _widen(ax, env, np.concatenate([proposed, training_goals]))
    label = "log density of the past there, nats"
    figure.colorbar(dots, ax=[left, right], label=label, extend="both", shrink=0.85)
    return figure


@styled
def policy_arrows(
    agent: Agent,
    env: BodyVectorEnv,
    goal: Float[np.ndarray, " 2"],
    *,
    planning: bool = False,
    batch: int = 200,
) -> Figure:
    """What the policy does everywhere, and if `planning` what that does, on the way to one goal.

    `batch` states at a time: best as many as the evaluation had, which is compiled already.
    """
    _, _, states = _grid(env, _ARROWS, inset=0.03)
    padded = np.resize(states, (-(-len(states) // batch) * batch, 2))
    goals = np.broadcast_to(goal, (batch, 2)).astype(np.float32)
    ways = {"policy": False} | ({"planning": True} if planning else {})
    figure = Figure(figsize=(WIDTH if planning else WIDTH / 2 + 0.2, 3.95))
    panels = figure.subplots(1, len(ways), sharey=True, squeeze=False)[0]
    for ax, (title, plan) in zip(panels, ways.items(), strict=True):
        parts = [
            agent.act(padded[i : i + batch], goals, plan=plan, seed=i)
            for i in range(0, len(padded), batch)
        ]
        actions = np.concatenate(parts)[: len(states)]
        ax.quiver(*states.T, *actions[:, :2].T, angles="xy", width=0.004, scale=24, pivot="mid")
        _furnish(ax, env, label_y=not plan)
        _star(ax, goal)
        ax.set_title(title)
    return figure


def _bounds(env: BodyVectorEnv) -> tuple[np.ndarray, np.ndarray]:
    space = env.single_observation_space
    assert isinstance(space, Box)
    return space.low, space.high


def _grid(
    env: BodyVectorEnv, points: int, inset: float = 0.0
) -> tuple[np.ndarray, np.ndarray, Float32[np.ndarray, "n 2"]]:
    low, high = _bounds(env)
    margin = inset * (high - low)
    xs, ys = np.linspace(low + margin, high - margin, points).T
    states = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    return xs, ys, states.astype(np.float32)


def _steps(
    agent: Agent, states: Float32[np.ndarray, "n 2"], goal: Float[np.ndarray, " 2"]
) -> Float[np.ndarray, " n"]:
    goals = np.broadcast_to(goal, states.shape).astype(np.float32)
    return np.asarray(agent.steps_to_goal(states, goals))


def _beyond(env: BodyVectorEnv, states: Float[np.ndarray, "n 2"]) -> float:
    """The share of states outside the body's bounds."""
    low, high = _bounds(env)
    return float(((states < low) | (states > high)).any(axis=1).mean())


def _widen(ax: Axes, env: BodyVectorEnv, states: Float[np.ndarray, "n 2"]) -> None:
    """Shows nearly all of the states, but not so much of nowhere that the world gets tiny."""
    low, high = _bounds(env)
    centre, half = (high + low) / 2, (high - low) / 2
    reach = np.percentile(np.abs(states - centre) / half, 95, axis=0).max()
    half = half * 1.06 * np.clip(reach, 1.0, 2.0)
    ax.set_xlim(centre[0] - half[0], centre[0] + half[0])
    ax.set_ylim(centre[1] - half[1], centre[1] + half[1])


def _furnish(ax: Axes, env: BodyVectorEnv, *, label_y: bool = True) -> None:
    """Bounds, the lie of the land, and names of the axes."""
    low, high = _bounds(env)
    pad = 0.03 * (high - low)
    ax.set_xlim(low[0] - pad[0], high[0] + pad[0])
    ax.set_ylim(low[1] - pad[1], high[1] + pad[1])
    ax.set_aspect("equal" if env.state_units[0] == env.state_units[1] else "auto")
    ax.grid(visible=False)
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    (x0, x1), (y0, y1) = zip(low, high, strict=True)
    ax.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=GREY, linewidth=0.8, linestyle="-")
    for x, y in CLIFFS.get(env.name, ()):
        ax.plot(x, y, color=BLACK, linewidth=1.8, linestyle="-")
    for x, y in SEAMS.get(env.name, ()):
        ax.plot(x, y, color=BLACK, linewidth=1.0, linestyle=":")
    names = [f"{n} ({u})" for n, u in zip(env.state_names, env.state_units, strict=True)]
    ax.set_xlabel(names[0])
    if label_y:
        ax.set_ylabel(names[1])


def _star(ax: Axes, goal: Float[np.ndarray, " 2"]) -> None:
    ax.plot(*goal, marker="*", markersize=13, color=RED, markeredgecolor="white", linestyle="none")
