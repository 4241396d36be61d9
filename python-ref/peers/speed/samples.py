"""Two samples of a surface without a common point: the Stanford dragon, else a relief."""

import cfreg
import numpy as np

from peers.methods.protocols import MESHES
from reference import scans


def samples(points):
    """Two float32 arrays (points, 3), with the sensor in the origin."""
    data = scans.data_folder()
    rng = np.random.default_rng(0)
    if data is not None and (data / MESHES["dragon"]).exists():
        surface = np.asarray(cfreg.read(data / MESHES["dragon"]).points, dtype=np.float64)
        surface = surface - surface.mean(axis=0) - [0.0, 0.0, 0.5]
    else:
        x, y = rng.uniform(-1, 1, (2, 4 * points))
        height = 0.3 * np.sin(3 * x + y) + 0.1 * np.cos(9 * y) * x + 0.05 * np.sin(14 * x * y)
        surface = np.column_stack([x, y, height - 3.0])
    order = rng.permutation(len(surface))
    half = min(points, len(surface) // 2)
    return [np.ascontiguousarray(surface[order[at : at + half]], np.float32) for at in (0, half)]
