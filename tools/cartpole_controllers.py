"""Controllers written by hand for the cartpole, which know its equations as no agent does.

They show where the body can be and stay: its goal suite is made of what they visit. Angles are in
rad from upright, turning to the right.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are

from everystate.envs import make

States = Float[np.ndarray, "envs 5"]
PULL = 1.5 * 9.81  # of gravity on the angle, in rad/s^2: a rod of 1 m that turns about its end
PUSH = 10 / 1.1  # of the motor on the cart, in m/s^2


class Gain(NamedTuple):
    """A linear feedback about a rest with the pole up or down."""

    angle: float
    gain: Float[np.ndarray, " 4"]

    def __call__(self, states: States, place: Float[np.ndarray, " envs"]) -> np.ndarray:
        """Actions towards rest at a place."""
        return -np.stack(_errors(states, place, self.angle), axis=1) @ self.gain


def regulator(angle: float) -> Gain:
    """The linear-quadratic regulator of the body's own control step, differenced numerically."""
    env, small = make("cartpole", 5, 0), 1e-4
    offsets = small * np.eye(5, 4)  # four components moved, and then the action alone
    env.set_observations(_states(offsets + np.array([0, angle, 0, 0])))
    actions = np.zeros((5, 1))
    actions[4] = small
    after = np.stack(_errors(env.step(actions)[0].astype(float), np.zeros(5), angle), axis=1)
    A, B = after[:4].T / small, after[4:].T / small
    P = solve_discrete_are(A, B, np.diag([1.0, 1.0, 0.3, 0.1]), np.array([[0.3]]))
    return Gain(angle, np.linalg.solve(0.3 + B.T @ P @ B, B.T @ P @ A)[0])


def pump(states: States, place: np.ndarray, speed: np.ndarray | float) -> np.ndarray:
    """Drives the pole's energy to that of passing the top at `speed` in rad/s, near a place."""
    x, cosine, _, v, w = states.T
    missing = PULL + 0.5 * np.square(speed) - (0.5 * w**2 + PULL * cosine)
    # From rest any push will do; towards the place is the best of them.
    kick = np.where(np.abs(w) < 0.05, np.sign(place - x), -np.sign(w * cosine))
    return np.clip(0.15 * missing, -0.7, 0.7) * kick - 0.35 * (x - place) - 0.25 * v


def _errors(states: States, place: np.ndarray, angle: float) -> tuple[np.ndarray, ...]:
    x, cosine, sine, v, w = states.T
    lean = np.arctan2(sine, cosine) - angle
    return x - place, (lean + np.pi) % (2 * np.pi) - np.pi, v, w


def _states(poses: Float[np.ndarray, "envs 4"]) -> States:
    x, angle, v, w = poses.T
    return np.stack([x, np.cos(angle), np.sin(angle), v, w], axis=1)
