"""Real scans for the checks, or procedural reliefs where there are none.

Scans are looked for in the folder of the environment variable CFREG_DATA, else in
../shared/data beside the repository. All coordinates are rounded to f32, the
precision of the crate's clouds.
"""

import csv
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from peers.programs import REPOSITORY, open3d
from reference.rotations import random_rotation
from reference.surfaces import VIEWPOINT, as_f32, relief

BUNNY = "stanford_bunny/bun000.ply"
DRAGON = "stanford_dragon_stand/dragonStandRight_0.ply"
ROOM = "3dmatch/fragments_vox25mm/7-scenes-redkitchen/cloud_bin_7.ply"


@dataclass(frozen=True)
class MovedPair:
    """Two independent samples of one surface, the target moved by a known pose."""

    name: str
    source: np.ndarray
    """(N, 3)"""
    target: np.ndarray
    """(M, 3), same unit"""
    source_viewpoint: np.ndarray
    target_viewpoint: np.ndarray
    rotation: np.ndarray
    """(3, 3), from source to target"""
    translation: np.ndarray

    def size(self):
        """Diagonal of the source's bounding box."""
        return float(np.linalg.norm(np.ptp(self.source, axis=0)))


def data_folder():
    """The folder of scans, or None."""
    named = os.environ.get("CFREG_DATA")
    folder = Path(named) if named else REPOSITORY.parent / "shared" / "data"
    return folder if folder.is_dir() else None


def read_pairs(path):
    """Rows of a list of pairs such as `pairs.csv`, each with its true pose (4, 4) as `truth`, or
    None where it has none."""
    with open(path, newline="") as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            known = bool(row["t00"])
            entries = [[float(row[f"t{i}{j}"]) for j in range(4)] for i in range(4)] if known else None
            yield row | {"truth": np.array(entries) if known else None}


def scan(name):
    """All points (N, 3) of a scan by its path from the data folder."""
    path = data_folder() / name
    points = open3d.read_points(path)
    if len(points) == 0:
        raise FileNotFoundError(f"no points in {path}")
    return as_f32(points)


def sample(points, count, rng):
    """`count` of the points, without repetition, in random order."""
    return points[rng.choice(len(points), min(count, len(points)), replace=False)]


def scan_pair(name, count, seed):
    """Two independent samples of a scan, the second moved by a large random pose.

    The scan was seen from the origin of its file, and the target from where the pose
    takes that place.
    """
    rng = np.random.default_rng(seed)
    points = scan(name)
    label = f"{Path(name).stem}, {count} points"
    return moved_pair(label, sample(points, count, rng), sample(points, count, rng), np.zeros(3), rng)


def relief_pair(count, seed):
    """Two independent samples of the procedural relief, the second moved."""
    rng = np.random.default_rng(seed)
    samples = relief(count, rng), relief(count, rng)
    return moved_pair(f"relief, {count} points", *samples, VIEWPOINT, rng)


def moved_pair(name, source, still, viewpoint, rng):
    """The pair of `source` and `still` moved by 110 degrees about a random axis and
    by a random translation of about the size of the cloud."""
    rotation = random_rotation(rng, degrees=110.0)
    translation = as_f32(0.5 * np.linalg.norm(np.ptp(still, axis=0)) * rng.normal(size=3))
    target = as_f32(still @ rotation.T + translation)
    target_viewpoint = as_f32(rotation @ viewpoint + translation)
    return MovedPair(name, source, target, viewpoint, target_viewpoint, rotation, translation)
