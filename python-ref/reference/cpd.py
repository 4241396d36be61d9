"""Rigid Coherent Point Drift (Myronenko and Song, PAMI 2010, fig. 2), with N x M matrices.

Source points are the centroids Y of the paper, target points its data X.
"""

import numpy as np

from .moments import moments, weighted_residual
from .pose import solve
from .weights import squared_distances


def cpd(source, target, outliers=0.1, scale="fixed", iterations=150):
    """The pose and sigma after so many EM steps from the identity.

    Clouds in root mean square radii of the target give what the crate computes: the
    uniform density 1 / M of the paper has a unit.
    """
    moved = source
    sigma2 = squared_distances(moved, target).mean() / 3
    for _ in range(iterations):
        c = (2 * np.pi * sigma2) ** 1.5 * outliers / (1 - outliers) * len(source) / len(target)
        kernel = np.exp(-squared_distances(moved, target) / (2 * sigma2))
        weights = kernel / (kernel.sum(axis=0) + c)
        sums = moments(weights, source, target)
        pose = solve(sums, "arun", scale)
        residual = weighted_residual(sums, pose.scale, pose.rotation, pose.translation)
        sigma2 = max(residual / (3 * sums.weight), 1e-12)
        moved = pose.scale * source @ pose.rotation.T + pose.translation
    return pose, np.sqrt(sigma2)
