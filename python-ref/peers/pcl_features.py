"""The paper's own way from two clouds to a pose: PCL's normals, FPFH and SIFT keypoints
(`pcl/described_points.cpp`), then its weights, moments and closed form (the reference)."""

import subprocess
import tempfile
from pathlib import Path

import numpy as np

import reference as ref
from pcl.programs import program


def described_points(points, k, sift=None):
    """Places (n, 3) and descriptors (n, 33) of all points, or of the keypoints of `sift`:
    smallest scale in the unit of the points, octaves, scales, least contrast."""
    with tempfile.TemporaryDirectory() as folder:
        cloud, out = Path(folder) / "cloud", Path(folder) / "out"
        np.savetxt(cloud, points, fmt="%.9g")
        settings = [repr(float(x)) if isinstance(x, float) else str(x) for x in sift or ()]
        command = [program("described_points"), cloud, out, str(k), *settings]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        rows = np.loadtxt(out, ndmin=2) if out.stat().st_size else np.empty((0, 36))
    return rows[:, :3], rows[:, 3:]


def pose(source, target, k=ref.NEIGHBORS, beta=ref.BETA, sifts=(None, None)):
    """The published answer (4, 4), and how many points of each cloud it connects; None
    where the weights leave the rotation open."""
    sides = [described_points(cloud, k, sift) for cloud, sift in zip((source, target), sifts)]
    counts = [len(places) for places, _ in sides]
    if min(counts) < 3:
        return None, counts
    (p, a), (q, b) = sides
    try:
        found = ref.solve(ref.moments(ref.weigh(ref.squared_distances(a, b), "gaussian", beta), p, q))
    except ref.SingularError:
        return None, counts
    return found.matrix(), counts
