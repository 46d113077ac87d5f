"""A goal suite for any body that has none of its own."""

import functools

import numpy as np
from jaxtyping import Float, Int

from everystate import envs
from everystate.errors import EverystateError
from everystate.evaluation.suite import Suite
from everystate.evaluation.suites import Split

_TASKS, _BODIES, _STEPS, _HORIZON = 200, 20, 400, 200


@functools.lru_cache(maxsize=4)
def on_the_spot(body: str, options: tuple[str, ...] = (), split: Split = "report") -> Suite:
    """States that random actions led to, spread as evenly as they allow, from others of them.

    A body does not get everywhere by chance, so this asks for less than a suite made by hand.

    Raises:
        EverystateError: success of the body is told by other components than its state's.
    """
    seed = 0 if split == "report" else 1
    env = envs.make(body, _BODIES, seed, **envs.parse_options(options))
    rng = np.random.default_rng(seed)
    # Reading the physics of a Gymnasium body takes longer than a step of it.
    read_at = set(rng.choice(_STEPS, _TASKS // _BODIES, replace=False).tolist())
    played, physics = [env.reset(seed=seed)[0]], []
    for step in range(_STEPS):
        if step in read_at:
            physics += env.get_physics()
        played.append(env.step(rng.uniform(-1, 1, env.action_space.shape))[0])
    states = np.stack(played).reshape(-1, len(env.state_names)).astype(float)
    sigma, names = env.scored(states).std(axis=0), env.state_names
    if sigma.shape != (len(names),):
        raise EverystateError(f"{body} needs a goal suite of its own: give a file of goals")
    moving = {n for n, unit in zip(names, env.state_units, strict=True) if unit.endswith("/s")}
    spread = states.std(axis=0)
    chosen = spread_out(states / np.where(spread > 1e-6, spread, 1), _TASKS)
    starts = rng.permutation(len(physics))[: len(chosen)]
    return Suite(
        body=body,
        name="visited",
        split=split,
        notes="Made on the spot from states reached by random actions.",
        seed=seed,
        components=tuple(names),
        sigma=np.where(sigma > 1e-6, sigma, 1.0),
        angular=(),
        position=tuple(name for name in names if name not in moving),
        velocity=tuple(name for name in names if name in moving),
        starts=tuple(physics[i] for i in starts),
        goals=states[chosen],
        weights=np.ones((len(chosen), len(names))),
        kinds=tuple(env.regions(states[chosen]).tolist()),
        k=np.zeros(len(chosen), dtype=np.int64),
        horizons=np.full(len(chosen), _HORIZON),
    )


def spread_out(points: Float[np.ndarray, "n dims"], count: int) -> Int[np.ndarray, " count"]:
    """Indices of points far from one another: each the farthest from all before it."""
    chosen = [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmin())]
    nearest = np.full(len(points), np.inf)
    for _ in range(min(count, len(points)) - 1):
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(nearest.argmax()))
    return np.array(chosen)
