"""The pairs of the trials, as `cfreg-paper reproduce --pairs` writes them, or small ones of a
procedural relief where it has not."""

from dataclasses import dataclass

import numpy as np

from peers.programs import pose_from
from reference.scans import moved_pair
from reference.surfaces import VIEWPOINT, relief


@dataclass(frozen=True)
class TrialPair:
    source: np.ndarray
    """(N, 3)"""
    target: np.ndarray
    """(M, 3)"""
    truth: np.ndarray
    """(4, 4) from source to target."""
    viewpoints: np.ndarray
    """(2, 3), where source and target were seen from."""

    def spacing(self):
        """Side of the square that a point of the source has to itself: of points strewn
        evenly on a surface, h² a point, half have their nearest neighbour within
        h sqrt(ln 2 / pi)."""
        distance = np.linalg.norm(self.source[:, None] - self.source, axis=2)
        np.fill_diagonal(distance, np.inf)
        return float(np.median(distance.min(axis=1)) / np.sqrt(np.log(2) / np.pi))


@dataclass(frozen=True)
class Cell:
    """The trials of a test, shape and motion."""

    name: str
    """test_reading_shape_motion"""
    pairs: list


def read(folder):
    """The cells of a folder, by name."""
    arrays = ("source", "target", "truth", "viewpoints")
    for place in sorted(path.parent for path in folder.glob("*/truth.npy")):
        trials = zip(*(np.load(place / f"{name}.npy") for name in arrays), strict=True)
        yield Cell(place.name, [TrialPair(*trial) for trial in trials])


def reliefs(trials):
    """Both tests on the relief, turned by 110 degrees."""
    for test in ("accuracy", "robustness"):
        rngs = (np.random.default_rng(number) for number in range(trials))
        yield Cell(f"{test}_fitting_relief_large", [relief_pair(test, rng) for rng in rngs])


def relief_pair(test, rng, points=500, outliers=100):
    source = relief(points, rng)
    if test == "accuracy":
        still = relief(points, rng)
    else:
        still = np.vstack([source, source.mean(axis=0) + rng.uniform(-1, 1, (outliers, 3))])
    pair = moved_pair("relief", source, still, VIEWPOINT, rng)
    truth = pose_from(pair.rotation, pair.translation)
    viewpoints = np.array([pair.source_viewpoint, pair.target_viewpoint])
    return TrialPair(pair.source, pair.target, truth, viewpoints)
