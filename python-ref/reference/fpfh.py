"""Fast Point Feature Histograms (Rusu, Blodow, Beetz: ICRA 2009).

Two conventions share all but the last line:

* `pcl` (PCL 1.13, what the paper used): the weighted mean of the neighbours' SPFH,
  each of the three blocks scaled to sum 100;
* `open3d` (Open3D 0.20, and eq. 4 of the ICRA paper): the same, and the point's own
  SPFH added, so that blocks sum to 200.

A histogram has 33 bins: 11 for theta, 11 for alpha, 11 for phi, in that order.
"""

import numpy as np

from .neighbours import nearest
from .paper import NEIGHBORS

BINS = 11
"""Bins of one feature."""

SCALES = ("pcl", "open3d")


def fpfh(points, normals, k=NEIGHBORS, scale="pcl"):
    """Descriptors (N, 33) of `points` with unit `normals`, both (N, 3).

    `k` nearest neighbours, the point itself counted, serve both passes.
    """
    if scale not in SCALES:
        raise ValueError(f"scale must be one of {SCALES}, not {scale!r}")
    points = np.asarray(points, dtype=np.float64)
    normals = np.asarray(normals, dtype=np.float64)
    indices, squared = nearest(points, k)
    single = simplified(points, normals, indices)
    described = weighted_means(single, indices, squared)
    return described if scale == "pcl" else described + single


def simplified(points, normals, indices):
    """SPFH (N, 33): counts of the features of each point with its neighbours, in
    percent, i.e. each pair adds 100 / (k - 1) to one bin of each block."""
    count = len(points)
    features = pair_features(points[:, None], normals[:, None], points[indices], normals[indices])
    others = indices != np.arange(count)[:, None]
    rows = np.broadcast_to(np.arange(count)[:, None], indices.shape)[others]
    increment = 100.0 / max(indices.shape[1] - 1, 1)
    histogram = np.zeros((count, 3 * BINS))
    for block, positions in enumerate(np.moveaxis(bin_positions(features), -1, 0)):
        bins = np.clip(np.floor(positions[others]), 0, BINS - 1).astype(np.int64)
        np.add.at(histogram, (rows, block * BINS + bins), increment)
    return histogram


def weighted_means(single, indices, squared):
    """Mean of the neighbours' SPFH with weights 1 / d², each block scaled to sum 100.

    The ICRA paper writes 1 / omega with omega a distance; PCL and Open3D take the
    squared one. Points at distance 0, the point itself first of all, are left out;
    a block without any weight stays zero.
    """
    described = np.zeros_like(single)
    for row, (neighbours, distances) in enumerate(zip(indices, squared)):
        apart = distances > 0
        blocks = ((1.0 / distances[apart]) @ single[neighbours[apart]]).reshape(3, BINS)
        sums = blocks.sum(axis=1, keepdims=True)
        scaled = np.divide(100.0 * blocks, sums, out=np.zeros((3, BINS)), where=sums > 0)
        described[row] = scaled.ravel()
    return described


def pair_features(p, n, q, m):
    """theta, alpha, phi (..., 3) of points p, q with normals n, m, all (..., 3).

    The point whose normal makes the smaller angle with the line between the two is
    the first (Rusu 2009, section II); p is where they tie, as with
    equal normals. With u its normal, d the line from it to the other, v = d x u / |d x u| and
    w = u x v:

        theta = atan2(w . m, u . m)    alpha = v . m    phi = u . d / |d|

    Degenerate pairs (coinciding points, or d parallel to u) are (0, 0, 0): PCL and
    Open3D both count them so, in the middle bins.
    """
    p, n, q, m = np.broadcast_arrays(p, n, q, m)
    line = q - p
    length = np.linalg.norm(line, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine_p = _dot(n, line) / length
        cosine_q = _dot(m, line) / length
        swap = np.abs(cosine_p) < np.abs(cosine_q)
        u = np.where(swap[..., None], m, n)
        other = np.where(swap[..., None], n, m)
        d = np.where(swap[..., None], -line, line)
        v = np.cross(d, u)
        area = np.linalg.norm(v, axis=-1)
        v = v / area[..., None]
        w = np.cross(u, v)
        theta = np.arctan2(_dot(w, other), _dot(u, other))
        alpha = _dot(v, other)
        phi = np.where(swap, -cosine_q, cosine_p)
    features = np.stack([theta, alpha, phi], axis=-1)
    features[(length == 0) | (area == 0)] = 0.0
    return features


def bin_positions(features):
    """Features on the scale of their bins, (..., 3) in [0, 11]: theta from
    [-pi, pi], alpha and phi from [-1, 1]. The integer part is the bin."""
    theta, alpha, phi = np.moveaxis(features, -1, 0)
    unit = [(theta + np.pi) / (2.0 * np.pi), (alpha + 1.0) / 2.0, (phi + 1.0) / 2.0]
    return BINS * np.stack(unit, axis=-1)


def _dot(a, b):
    return np.einsum("...i,...i->...", a, b)
