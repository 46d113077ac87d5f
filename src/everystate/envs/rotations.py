"""Orientations as numbers of a state, and back: quaternions are unit ones, (w, x, y, z)."""

import numpy as np
from jaxtyping import Float

Quaternions = Float[np.ndarray, "n 4"]


def two_columns(quaternions: Quaternions) -> Float[np.ndarray, "n 6"]:
    """The first two columns of the rotation matrices."""
    w, x, y, z = quaternions.T
    columns = np.empty((len(quaternions), 6))
    columns[:, 0] = 1 - 2 * (y * y + z * z)
    columns[:, 1] = 2 * (x * y + w * z)
    columns[:, 2] = 2 * (x * z - w * y)
    columns[:, 3] = 2 * (x * y - w * z)
    columns[:, 4] = 1 - 2 * (x * x + z * z)
    columns[:, 5] = 2 * (y * z + w * x)
    return columns


def of_columns(columns: Float[np.ndarray, "n 6"]) -> Quaternions:
    """The rotations whose matrices have nearly these two columns, by Gram and Schmidt."""
    first = _unit(columns[:, :3], [1.0, 0.0, 0.0])
    along = (columns[:, 3:] * first).sum(axis=1, keepdims=True)
    # Where the second is no direction of its own, any that stands on the first will do.
    spare = np.roll(first, 1, axis=1)
    spare -= (spare * first).sum(axis=1, keepdims=True) * first
    second = _unit(columns[:, 3:] - along * first, spare)
    matrices = np.stack([first, second, np.cross(first, second)], axis=-1)
    from scipy.spatial.transform import Rotation  # which takes long to import

    return Rotation.from_matrix(matrices).as_quat(canonical=True, scalar_first=True)


def up(quaternions: Quaternions) -> Float[np.ndarray, "n 3"]:
    """Where up is to the body: the world's z axis in the body's frame, without the heading."""
    w, x, y, z = quaternions.T
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)


def of_up(ups: Float[np.ndarray, "n 3"]) -> Quaternions:
    """The rotations with heading 0 under which up is nearly there: by an axis that lies level."""
    x, y, z = _unit(ups, [0.0, 0.0, 1.0]).T
    w = np.sqrt(np.maximum(1 + z, 0.0) / 2)
    over = w < 1e-6  # upside down: there by any level axis
    half = np.where(over, 1.0, 2 * w)
    found = np.stack([w, np.where(over, 1.0, y / half), -x / half, np.zeros_like(w)], axis=1)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def headings(
    levels: Quaternions, spins: Float[np.ndarray, "n 3"], seconds: float
) -> Float[np.ndarray, " n"]:
    """Radians about the world's z axis by which a body has turned after each step of a path.

    Args:
        levels: its orientations with heading 0, as `of_up` gives them.
        spins: its angular velocities in its own frame, in rad/s.
        seconds: of a step.
    """
    turned = (spins[1:] + spins[:-1]) / 2 * seconds
    angle = np.linalg.norm(turned, axis=1, keepdims=True)
    axis = np.sinc(angle / (2 * np.pi)) / 2 * turned
    ahead = _times(levels[:-1], np.concatenate([np.cos(angle / 2), axis], axis=1))
    apart = _times(ahead, levels[1:] * [1.0, -1.0, -1.0, -1.0])
    steps = 2 * np.arctan2(apart[:, 3], apart[:, 0])  # the part about z of what lies between
    return np.concatenate([[0.0], np.cumsum((steps + np.pi) % (2 * np.pi) - np.pi)])


def about_z(headings: Float[np.ndarray, " n"], quaternions: Quaternions) -> Quaternions:
    """Orientations, turned on by angles about the world's z axis."""
    zero = np.zeros_like(headings)
    turn = np.stack([np.cos(headings / 2), zero, zero, np.sin(headings / 2)], axis=1)
    return _times(turn, quaternions)


def to_world(
    quaternions: Quaternions, vectors: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Vectors of the body's frame in the world's."""
    w, axis = quaternions[:, :1], quaternions[:, 1:]
    twice = 2 * np.cross(axis, vectors)
    return vectors + w * twice + np.cross(axis, twice)


def to_body(
    quaternions: Quaternions, vectors: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Vectors of the world's frame in the body's."""
    return to_world(quaternions * [1.0, -1.0, -1.0, -1.0], vectors)


def _times(a: Quaternions, b: Quaternions) -> Quaternions:
    w = a[:, :1] * b[:, :1] - (a[:, 1:] * b[:, 1:]).sum(axis=1, keepdims=True)
    axis = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.concatenate([w, axis], axis=1)


def _unit(vectors: Float[np.ndarray, "n 3"], otherwise) -> Float[np.ndarray, "n 3"]:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    vectors = np.where(lengths > 1e-6, vectors, otherwise)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
