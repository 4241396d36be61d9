"""Rotations (3, 3) and motions (4, 4), from quaternions, vectors and random numbers."""

import numpy as np


def random_rotation(rng, degrees=None):
    """A rotation about a random axis, by `degrees` or uniform over SO(3)."""
    if degrees is None:
        return from_quaternion(rng.normal(size=4))
    axis = rng.normal(size=3)
    half = np.radians(degrees) / 2.0
    return from_quaternion(np.append(np.cos(half), np.sin(half) * axis / np.linalg.norm(axis)))


def from_quaternion(quaternion):
    """The rotation of a quaternion (4,), scalar first, of any length."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def from_vector(vector):
    """The rotation about `vector` by its length (Rodrigues)."""
    angle = np.linalg.norm(vector)
    if angle == 0.0:
        return np.eye(3)
    k = cross_matrix(vector / angle)
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k


def cross_matrix(v):
    """K with K x = v cross x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def about(rotation, center):
    """The motion (4, 4) of a rotation about a place."""
    motion = np.eye(4)
    motion[:3, :3] = rotation
    motion[:3, 3] = center - rotation @ center
    return motion


def direction(rng):
    """A random unit vector."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)
