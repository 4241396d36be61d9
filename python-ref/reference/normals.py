"""Normals and curvature by principal components of the k nearest points.

The normal is the direction in which the neighbourhood extends least (R. B. Rusu,
Semantic 3D Object Maps, thesis 2009, section 4.3); PCL and Open3D do the same.
"""

import numpy as np

from .neighbours import nearest
from .paper import NEIGHBORS


def normals(points, k=NEIGHBORS, viewpoint=(0.0, 0.0, 0.0)):
    """Unit normals (N, 3) and curvatures (N,).

    `k` counts the point itself. Curvature is the surface variation
    l0 / (l0 + l1 + l2) with l0 <= l1 <= l2 the eigenvalues of the covariance, in
    [0, 1/3]; 0 where all k points coincide. Normals look towards `viewpoint`.
    """
    points = np.asarray(points, dtype=np.float64)
    values, vectors = principal_axes(points, k)
    total = values.sum(axis=1)
    curvature = np.divide(values[:, 0], total, out=np.zeros(len(points)), where=total > 0)
    return oriented(points, vectors[:, :, 0], viewpoint), curvature


def principal_axes(points, k):
    """Eigenvalues (N, 3) ascending, >= 0, and eigenvectors (N, 3, 3) in columns of
    each neighbourhood's covariance about its own mean (divided by k)."""
    indices, _ = nearest(points, k)
    covariances = np.empty((len(points), 3, 3))
    for row, neighbours in enumerate(indices):
        centred = points[neighbours] - points[neighbours].mean(axis=0)
        covariances[row] = centred.T @ centred / len(neighbours)
    values, vectors = np.linalg.eigh(covariances)
    return np.maximum(values, 0.0), vectors


def oriented(points, directions, viewpoint):
    """The directions, each flipped where (viewpoint - p) . n < 0."""
    towards = np.asarray(viewpoint, dtype=np.float64) - points
    away = np.einsum("ij,ij->i", towards, directions) < 0
    return np.where(away[:, None], -directions, directions)
