"""How far two poses (4, 4) are apart."""

import numpy as np


def rotation_degrees(a, b):
    """Degrees between the rotations of two poses, exact for small ones."""
    turn = a[:3, :3] @ b[:3, :3].T
    sine = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    return float(np.degrees(np.arctan2(np.linalg.norm(sine), np.trace(turn) - 1.0)))


def centroid_shift(a, b, points):
    """Distance between where two poses put the centroid of `points`, over their size."""
    center = points.mean(axis=0)
    apart = (a - b)[:3, :3] @ center + (a - b)[:3, 3]
    return float(np.linalg.norm(apart) / np.linalg.norm(np.ptp(points, axis=0)))


def frobenius(a, b):
    """The paper's accuracy (section IV-D): norm of I - R_a R_b^T."""
    return float(np.linalg.norm(np.eye(3) - a[:3, :3] @ b[:3, :3].T))


def mean_shift(a, b, points):
    """The paper's robustness (section IV-B): mean distance between where two poses put `points`."""
    apart = points @ (a - b)[:3, :3].T + (a - b)[:3, 3]
    return float(np.linalg.norm(apart, axis=1).mean())
