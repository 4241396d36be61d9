"""Kernel correlation registration (Y. Tsin and T. Kanade, ECCV 2004), with N x M matrices.

Two points, each blurred by a Gaussian of variance sigma² / 2, have the kernel correlation
exp(-d² / 2 sigma²) but for a constant; that of two clouds under a pose is the sum over all
pairs, one of either. Their cost of a registration is its negative.

The sum is made greatest by majorisation: exp(-x) is convex and lies above its tangent, so
the closed form with the weights exp(-d² / 2 sigma²) of the current pose never lowers it.
"""

from dataclasses import dataclass

import numpy as np

from .moments import moments
from .pose import Pose, solve
from .weights import squared_distances


@dataclass(frozen=True)
class Step:
    """One step at one sigma."""

    sigma: float
    correlation: float
    """At the pose that the step starts from."""
    pose: Pose
    """That the step ends in."""


def correlation(source, target, pose, sigma):
    """sum over all pairs of exp(-d² / 2 sigma²) under `pose`."""
    moved = pose.scale * source @ pose.rotation.T + pose.translation
    return kernel(moved, target, sigma).sum()


def kernel(moved, target, sigma):
    """(N, M) exp(-d² / 2 sigma²)."""
    return np.exp(-squared_distances(moved, target) / (2 * sigma**2))


def steps(source, target, initial, schedule, tolerance, max_iterations):
    """Every step from the pose `initial`, for each sigma of `schedule` until the
    correlation grows by no more than the share `tolerance` of itself."""
    pose, result = initial, []
    for sigma in schedule:
        before = -np.inf
        for _ in range(max_iterations):
            moved = pose.scale * source @ pose.rotation.T + pose.translation
            weights = kernel(moved, target, sigma)
            pose = solve(moments(weights, source, target))
            result.append(Step(sigma, weights.sum(), pose))
            settled = weights.sum() - before <= tolerance * weights.sum()
            before = weights.sum()
            if settled:
                break
    return result


def schedule(first, last, factor):
    """first, first * factor, ... and last at the end."""
    sigmas = [first]
    while sigmas[-1] > last:
        sigmas.append(max(sigmas[-1] * factor, last))
    return sigmas
