"""Controllers written by hand for the ant, which know its joints as no agent does.

They show what states it can be in and stay in: its goal suite is made of what they visit.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from everystate.envs import BodyVectorEnv

States = Float[np.ndarray, "envs 29"]
HIPS, ANKLES = slice(0, 8, 2), slice(1, 8, 2)
JOINTS, SPEEDS = slice(7, 15), slice(21, 29)
CENTRE = np.array([0.0, 0.895] * 4)  # rad, the middle of each joint's range
REACH = np.array([0.524, 1.244] * 4)  # rad, from there to its limits


def towards(states: States, poses: Float[np.ndarray, "envs 8"]) -> Float[np.ndarray, "envs 8"]:
    """Actions that hold the joints at angles, as a spring and a damper would."""
    return 1.5 * (poses - states[:, JOINTS]) - 0.15 * states[:, SPEEDS]


def poses(rng: np.random.Generator, num: int) -> Float[np.ndarray, "envs 8"]:
    """Angles anywhere within nine tenths of the joints' ranges."""
    return CENTRE + 0.9 * REACH * rng.uniform(-1, 1, (num, 8))


class Gait:
    """Joints that swing at one rhythm, each with an amplitude, offset and phase of its own."""

    def __init__(self, rng: np.random.Generator, num: int) -> None:
        self.period = rng.uniform(6, 20, (num, 1))  # control steps
        self.phase = rng.uniform(0, 2 * np.pi, (num, 8))
        self.middle = CENTRE + 0.5 * REACH * rng.uniform(-1, 1, (num, 8))
        self.swing = REACH * rng.uniform(0, 1, (num, 8))

    def __call__(self, states: States, step: int) -> Float[np.ndarray, "envs 8"]:
        """Actions towards where the joints are to be now."""
        turn = np.sin(2 * np.pi * step / self.period + self.phase)
        return towards(states, self.middle + self.swing * turn)


class Round(NamedTuple):
    """What ants did for a while."""

    posing: Bool[np.ndarray, " envs"]
    """Who went to a pose and stayed there."""
    observations: Float[np.ndarray, "steps envs 29"]
    actions: Float[np.ndarray, "steps envs 8"]
    next_observations: Float[np.ndarray, "steps envs 29"]


def play(
    env: BodyVectorEnv, states: States, rng: np.random.Generator, rounds: int, steps: int
) -> Iterator[Round]:
    """Ants that in every round act at random, walk by a gait, or take up a pose, each its own."""
    num = len(states)
    for _ in range(rounds):
        angles, gait, what = poses(rng, num), Gait(rng, num), rng.integers(3, size=num)
        wild, taken = np.empty((num, 8)), []
        for step in range(steps):
            if step % 4 == 0:
                wild = rng.uniform(-1, 1, (num, 8))
            now = states.astype(float)
            choices = [wild, gait(now, step), towards(now, angles)]
            actions = np.choose(what[:, None], choices).clip(-1, 1)
            after = env.step(actions)[0]
            taken.append((states, actions, after))
            states = after
        yield Round(what == 2, *(np.stack(column) for column in zip(*taken, strict=True)))
