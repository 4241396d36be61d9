"""Rigid Coherent Point Drift (Myronenko and Song, PAMI 2010, fig. 2), with N x M matrices.

Source points are the centroids Y of the paper, target points its data X.
"""

from dataclasses import dataclass

import numpy as np

from .moments import moments, weighted_residual
from .pose import Pose, solve
from .weights import squared_distances

LEAST_SIGMA = 1e-6
"""In units: a perfect fit has none, and its square must not become negative by rounding."""


@dataclass(frozen=True)
class Step:
    """One step of expectation maximisation."""

    sigma: float
    """With which the E-step is made."""
    objective: float
    """Negative log-likelihood a target point without constants, before the M-step."""
    weight: float
    """N_P, the sum of all responsibilities."""
    pose: Pose
    """After the M-step."""
    next_sigma: float


def cpd(source, target, outliers=0.1, scale="fixed", iterations=150):
    """The pose and sigma after so many EM steps from the identity."""
    last = steps(source, target, outliers, scale, iterations)[-1]
    return last.pose, last.next_sigma


def steps(source, target, outliers, scale, iterations, unit=1.0):
    """Every EM step from the identity.

    `unit` is the length in which densities are measured: the uniform density 1 / M of
    the paper has one. The crate's is the root mean square radius of the target.
    """
    moved, result = source, []
    sigma = np.sqrt(squared_distances(moved, target).mean() / 3)
    for _ in range(iterations):
        spread = 2 * np.pi * (sigma / unit) ** 2
        c = spread**1.5 * outliers / (1 - outliers) * len(source) / len(target)
        kernel = np.exp(-squared_distances(moved, target) / (2 * sigma**2))
        mixture = kernel.sum(axis=0) + c
        objective = 3 * np.log(sigma / unit) - np.log(mixture).mean()
        sums = moments(kernel / mixture, source, target)
        pose = solve(sums, "arun", scale)
        residual = weighted_residual(sums, pose.scale, pose.rotation, pose.translation)
        sigma2 = max(residual / (3 * sums.weight), (LEAST_SIGMA * unit) ** 2)
        result.append(Step(sigma, objective, sums.weight, pose, np.sqrt(sigma2)))
        sigma = result[-1].next_sigma
        moved = pose.scale * source @ pose.rotation.T + pose.translation
    return result
