"""SC2-PCR on given matches (Chen, Sun, Yang and Tao, CVPR 2022), by the steps of its figure 2.

Matches are compatible when they keep their distance, and compatible to the second order
when many others are compatible with both. Sets of such matches about a few seeds each
give a pose; the one with most inliers stays, and is solved again from these.
"""

import numpy as np

from .moments import moments
from .pose import SingularError, solve

SEEDS = 0.2
"""Seeds, of the number of matches."""
FIRST, SECOND = 30, 20
"""Matches that the first and the second stage keep about a seed."""
REFINEMENTS = 20
"""Most times that the best pose is solved again from its inliers."""


def sc2pcr(source, target, threshold):
    """The pose (4, 4) of matches `source[k]`, `target[k]`; a right one is off by less than
    `threshold`. None where no seed has matches that determine a pose."""
    distance = [np.linalg.norm(p[:, None] - p, axis=2) for p in (source, target)]
    difference = np.abs(distance[0] - distance[1])
    # C_ij, compatible to the first order: more or less, and yes or no.
    soft = np.maximum(0.0, 1.0 - (difference / threshold) ** 2)
    hard = (difference <= threshold).astype(float)
    measure = second_order(hard)
    # Step 5: the pose with most inliers.
    best, most = None, 0
    for seed in seeds(leading_eigenvector(soft), distance[0], threshold):
        members = consensus(hard, measure, seed)
        pose = spectral_pose(hard[np.ix_(members, members)], source[members], target[members])
        count = 0 if pose is None else inliers(pose, source, target, threshold).sum()
        if count > most:
            best, most = pose, count
    return None if best is None else refined(best, source, target, threshold)


def second_order(hard):
    """Step 1: how many matches are compatible with both of two compatible ones,
    SC2_ij = C_ij sum_k C_ik C_kj."""
    return hard * (hard @ hard)


def seeds(confidence, distance, radius):
    """Step 2: matches that nobody within `radius` in the source surpasses, the most
    confident first, a share `SEEDS` of all at most."""
    rivals = np.where(distance < radius, confidence[None, :], 0.0).max(axis=1)
    peaks = np.flatnonzero(confidence >= rivals)
    by_confidence = peaks[np.argsort(-confidence[peaks], kind="stable")]
    return by_confidence[: max(1, int(SEEDS * len(confidence)))]


def consensus(hard, measure, seed):
    """Step 3: the `FIRST` matches closest to the seed by the measure over all matches,
    of these the `SECOND` closest by the measure among them."""
    near = highest(measure[seed], FIRST)
    local = hard[np.ix_(near, near)]
    own = hard[seed, near]
    return near[highest(own * (local @ own), SECOND)]


def spectral_pose(hard, source, target):
    """Step 4: the weighted least-squares pose of a consensus set, weights from the
    leading eigenvector of its own second-order measure; None where it has none."""
    return weighted_pose(leading_eigenvector(second_order(hard)), source, target)


def refined(pose, source, target, threshold):
    """The pose solved from its inliers, as long as that gives it more."""
    count = 0
    for _ in range(REFINEMENTS):
        within = inliers(pose, source, target, threshold)
        again = weighted_pose(within.astype(float), source, target)
        if within.sum() <= count or again is None:
            break
        pose, count = again, within.sum()
    return pose


def inliers(pose, source, target, threshold):
    rest = source @ pose[:3, :3].T + pose[:3, 3] - target
    return np.linalg.norm(rest, axis=1) < threshold


def weighted_pose(weights, source, target):
    """The closed form (Arun) over matches, whose weights are a diagonal."""
    try:
        return solve(moments(np.diag(weights), source, target)).matrix()
    except SingularError:
        return None


def leading_eigenvector(symmetric):
    """That of a matrix without negative entries, which has none either (Perron and Frobenius)."""
    return np.abs(np.linalg.eigh(symmetric)[1][:, -1])


def highest(values, count):
    """Indices of the `count` highest values, ties to the lower index."""
    return np.argsort(-values, kind="stable")[:count]
