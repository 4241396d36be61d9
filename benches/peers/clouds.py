"""Two samples of a surface without a common point: the Stanford dragon, else a relief."""

import os
from pathlib import Path

import cfreg
import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]


def samples(points):
    """Two float32 arrays (points, 3), with the sensor in the origin."""
    root = Path(os.environ.get("CFREG_DATA", REPOSITORY.parent / "shared" / "data"))
    mesh = root / "stanford_meshes" / "dragon_vrip_res2.ply"
    rng = np.random.default_rng(0)
    if mesh.exists():
        surface = np.asarray(cfreg.read(mesh).points, dtype=np.float64)
        surface = surface - surface.mean(axis=0) - [0.0, 0.0, 0.5]
    else:
        x, y = rng.uniform(-1, 1, (2, 4 * points))
        height = 0.3 * np.sin(3 * x + y) + 0.1 * np.cos(9 * y) * x + 0.05 * np.sin(14 * x * y)
        surface = np.column_stack([x, y, height - 3.0])
    order = rng.permutation(len(surface))
    half = min(points, len(surface) // 2)
    return [np.ascontiguousarray(surface[order[at : at + half]], np.float32) for at in (0, half)]


def angle_deg(a, b):
    """Angle between the rotations of two poses."""
    turn = a[:3, :3] @ b[:3, :3].T
    sine = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    return float(np.degrees(np.arctan2(np.linalg.norm(sine), np.trace(turn) - 1.0)))
