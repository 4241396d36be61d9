"""Keypoint detectors: SIFT in 3-D, and intrinsic shape signatures.

* SIFT: no paper defines it on a cloud; this is what PCL 1.13's `SIFTKeypoint` computes,
  after D. Lowe, IJCV 2004, section 3, on one number a point.
* ISS: Y. Zhong, ICCV workshops 2009, as Open3D 0.19 reads it: the covariance is about the
  mean of the neighbourhood and all neighbours count alike. (PCL's is about the point
  itself and a sum, so that density decides too.)
"""

import numpy as np

from .neighbours import ROWS_AT_ONCE, nearest

RIVALS = 25
"""Nearest points, itself counted, among which an extremum of SIFT is one."""

REACH = 3.0
"""Standard deviations at which a Gaussian ends."""


# --- SIFT --------------------------------------------------------------------------


def sift(points, values, min_scale, octaves=3, scales=4, min_contrast=0.0, corner=None):
    """Indices of the keypoints, ascending: the point nearest to each extremum."""
    points = np.asarray(points, dtype=np.float64)
    found = set()
    for thin, _, extrema in sift_octaves(
        points, values, min_scale, octaves, scales, min_contrast, corner
    ):
        found.update(int(((points - place) ** 2).sum(axis=1).argmin()) for place in thin[extrema])
    return np.array(sorted(found), dtype=np.int64)


def sift_octaves(points, values, min_scale, octaves=3, scales=4, min_contrast=0.0, corner=None):
    """Per octave the downsampled points (n, 3), their values (n,) and the indices of the
    extrema among them. Each octave thins the points of the one before, by a grid from
    `corner`: the lowest of the cloud by default, (0, 0, 0) in PCL."""
    corner = np.min(points, axis=0) if corner is None else np.asarray(corner)
    for octave in range(octaves):
        scale = min_scale * 2**octave
        points, values = downsampled(points, values, scale, corner)
        if len(points) < RIVALS:
            return
        differences = difference_of_gaussians(points, values, scale, scales)
        yield points, values, extrema(points, differences, min_contrast)


def downsampled(points, values, size, corner):
    """Mean point and mean value of every occupied cube of a grid of side `size` from
    `corner`, rounded to f32, as clouds keep them."""
    points = np.asarray(points, dtype=np.float64)
    cubes = np.floor((points - corner) / size).astype(np.int64)
    _, cube = np.unique(cubes, axis=0, return_inverse=True)
    cube = cube.ravel()
    count = np.bincount(cube)
    means = [np.bincount(cube, column) / count for column in (*points.T, np.asarray(values, float))]
    means = np.stack(means, axis=1).astype(np.float32).astype(np.float64)
    return means[:, :3], means[:, 3]


def difference_of_gaussians(points, values, scale, scales):
    """(n, scales + 2): the values smoothed at scale 2^((i - 1) / scales), i = 0 to
    scales + 2, each less the one before."""
    sigmas = scale * 2.0 ** ((np.arange(scales + 3) - 1.0) / scales)
    smooth = np.empty((len(points), len(sigmas)))
    for rows, squared in distances(points):
        for level, sigma in enumerate(sigmas):
            inside = squared <= (REACH * sigma) ** 2
            weights = np.where(inside, np.exp(-0.5 * squared / sigma**2), 0.0)
            smooth[rows, level] = weights @ values / weights.sum(axis=1)
    return np.diff(smooth, axis=1)


def extrema(points, differences, min_contrast):
    """Indices of the points whose difference, at a scale with one on either side, is the
    least or the greatest of the 25 nearest there, and strictly beyond theirs beside."""
    rivals = nearest(points, RIVALS)[0]
    around = differences[rivals]  # (n, 25, scales + 2)
    here = differences[:, 1:-1]
    found = np.zeros(len(points), dtype=bool)
    for sign in (1.0, -1.0):
        least = (sign * around).min(axis=1)
        found |= (
            (sign * here == least[:, 1:-1])
            & (sign * here < least[:, :-2])
            & (sign * here < least[:, 2:])
            & (np.abs(here) >= min_contrast)
        ).any(axis=1)
    return np.flatnonzero(found)


# --- ISS ---------------------------------------------------------------------------


def iss(points, salient_radius, non_max_radius, gamma21=0.975, gamma32=0.975, min_neighbors=5):
    """Indices of the keypoints, ascending: of the points whose eigenvalues l1 >= l2 >= l3
    have l2 / l1 < gamma21 and l3 / l2 < gamma32, those whose l3 is the largest around."""
    points = np.asarray(points, dtype=np.float64)
    saliency = np.zeros(len(points))
    for row, (third, second, first) in enumerate(spreads(points, salient_radius, min_neighbors)):
        if second < gamma21 * first and third < gamma32 * second:
            saliency[row] = third
    found = []
    for rows, squared in distances(points):
        for row, line in zip(range(len(points))[rows], squared):
            around = line <= non_max_radius**2
            if saliency[row] > 0 and around.sum() >= min_neighbors:
                if saliency[around].max() <= saliency[row]:
                    found.append(row)
    return np.array(found, dtype=np.int64)


def spreads(points, radius, min_neighbors):
    """Eigenvalues (N, 3), ascending, of the covariance of the points within `radius`,
    itself included; zeros where there are fewer than `min_neighbors`."""
    values = np.zeros((len(points), 3))
    for rows, squared in distances(points):
        for row, line in zip(range(len(points))[rows], squared):
            inside = points[line <= radius**2]
            if len(inside) >= min_neighbors:
                values[row] = np.linalg.eigvalsh(np.cov(inside.T, bias=True))
    return values


def distances(points):
    """Squared distances of some rows to all points: (rows, (n, N)) at a time."""
    for start in range(0, len(points), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        yield rows, ((points[rows, None] - points[None]) ** 2).sum(axis=2)
