"""The crate's answer to a pair, and how far two poses are apart."""

from dataclasses import dataclass

import numpy as np


def part(found, name):
    """What the crate's answer, or a part of it, says under that name: an object or a dict."""
    return getattr(found, name) if hasattr(found, name) else found[name]


def pose_of(found):
    """The (4, 4) pose of an answer, or of a step of its trace."""
    return np.asarray(part(found, "transform"), dtype=np.float64)


@dataclass(frozen=True)
class Answer:
    """The crate's answer to a source that was moved to `initial` before; poses are those of
    the source as it was."""

    found: object
    initial: np.ndarray

    def __getitem__(self, name):
        return self.pose(self.found) if name == "transform" else part(self.found, name)

    def pose(self, found):
        return pose_of(found) @ self.initial


def register(source, target, method, initial=None, **settings):
    """The crate's `Answer`; `initial` is the pose (4, 4) that it starts from."""
    import cfreg

    initial = np.eye(4) if initial is None else np.asarray(initial)
    moved = source @ initial[:3, :3].T + initial[:3, 3]
    return Answer(cfreg.register(moved, target, method=method, **settings), initial)


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
