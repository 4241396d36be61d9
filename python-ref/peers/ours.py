"""The crate's answer to a pair, and how far two poses are apart."""

import numpy as np


def register(source, target, method, **settings):
    """The crate's registration; its module is needed from here on only."""
    import cfreg

    return cfreg.register(source, target, method, **settings)


def angle(a, b):
    """Degrees between the rotations of two poses (4, 4), exact for small ones."""
    turn = a[:3, :3] @ b[:3, :3].T
    sine = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    return float(np.degrees(np.arctan2(np.linalg.norm(sine), np.trace(turn) - 1.0)))


def shift(a, b, points):
    """Distance between where two poses put the centroid of `points`, over their size."""
    center = points.mean(axis=0)
    apart = (a - b)[:3, :3] @ center + (a - b)[:3, 3]
    return float(np.linalg.norm(apart) / np.linalg.norm(np.ptp(points, axis=0)))


def frobenius(a, b):
    """The paper's accuracy (section IV-D): norm of I - R_a R_b^T."""
    return float(np.linalg.norm(np.eye(3) - a[:3, :3] @ b[:3, :3].T))
