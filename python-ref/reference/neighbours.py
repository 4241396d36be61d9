"""The k nearest points by brute force: no tree to trust, and ties are decided.

PCL and Open3D ask a k-d tree for the k nearest *including the point itself*; so
does this module. Where several points share the k-th distance a tree keeps any of
them; here the lower index wins, and `separation` tells how far from such a tie
each neighbourhood is.
"""

import numpy as np

ROWS_AT_ONCE = 256
"""Rows of the distance matrix held in memory together."""


def nearest(points, k):
    """Indices (N, k) and squared distances (N, k), nearest first.

    The point itself is one of its own k neighbours, at distance 0. Equal distances
    are ordered by index. With fewer than k points all of them are neighbours.
    """
    points = np.asarray(points, dtype=np.float64)
    k = min(k, len(points))
    indices = np.empty((len(points), k), dtype=np.int64)
    squared = np.empty((len(points), k))
    for start in range(0, len(points), ROWS_AT_ONCE):
        rows = slice(start, min(start + ROWS_AT_ONCE, len(points)))
        distances = _squared_distance_rows(points[rows], points)
        farthest = np.partition(distances, k - 1, axis=1)[:, k - 1]
        for row, (line, bound) in enumerate(zip(distances, farthest), start):
            candidates = np.flatnonzero(line <= bound)
            order = np.argsort(line[candidates], kind="stable")[:k]
            indices[row] = candidates[order]
            squared[row] = line[indices[row]]
    return indices, squared


def separation(points, k):
    """How clearly the k-th neighbour is nearer than the next, (N,), relative.

    (d²[k+1] - d²[k]) / d²[k]: zero is a tie, and below a few f32 roundings two right
    programs may keep different points. Infinite where there is no next point.
    """
    if len(points) <= k:
        return np.full(len(points), np.inf)
    _, squared = nearest(points, k + 1)
    last, following = squared[:, -2], squared[:, -1]
    gap = np.full(len(points), np.inf)
    np.divide(following - last, last, out=gap, where=last > 0)
    gap[(last == 0) & (following == 0)] = 0.0
    return gap


def _squared_distance_rows(some, points):
    """Squared distances (S, N) by plain differences, exact for near points."""
    total = np.zeros((len(some), len(points)))
    for axis in range(3):
        difference = some[:, axis, None] - points[None, :, axis]
        total += difference * difference
    return total
