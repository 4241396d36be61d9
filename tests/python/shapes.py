"""Clouds for the tests of the Python package."""

import numpy as np


def terrain(count, seed=0):
    """Points (count, 3) on a surface without symmetry, float64."""
    x, y = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, count))
    z = 0.4 * np.sin(3.0 * x + y) + 0.3 * np.cos(2.0 * y - x * y) + 0.2 * x * x - 2.0
    return np.column_stack([x, y, z])


def turned(points):
    """The points a quarter turn about z, and the (4, 4) matrix that did it."""
    matrix = np.eye(4)
    matrix[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    return points @ matrix[:3, :3].T, matrix
