"""Iterative closest point and the evaluation of a pose beside Open3D's.

Both run to rest from the same wrong pose with the same longest pair (`peers.methods.icp`); the
evaluation is of the same pose at the same distance.
"""

import numpy as np
from scipy.spatial import cKDTree

from peers.methods import protocols
from peers.methods.icp import METHODS, open3d_from, crate_from
from peers.programs import crate, open3d
from reference import scans
from reference.pose_error import centroid_shift, rotation_degrees
from reference.rotations import about, direction, from_vector, random_rotation
from reference.surfaces import as_f32, relief

POINTS = 2000
DEGREES, SHARE = 4.0, 0.01
"""How far from the true pose ICP starts: about a random axis, and of the size."""
TIE = 1e-6
"""Relative difference of two distances that f32 may decide otherwise."""

BOUNDS = {
    "icp: rotation apart, degrees": (1e-4, "steps of 1e-6 rad, 6e-5 degrees, are rest"),
    "icp: translation apart / size": (2e-6, "steps of 1e-6 radii are rest"),
    "evaluation: fitness, beyond pairs in doubt": (1e-12, "a share of counts"),
    "evaluation: inlier rmse, relative": (1e-6, "distances in f32"),
}


def sections(scope):
    if not scope.cfreg:
        return
    for pair in pairs():
        yield f"{pair.name}, {len(pair.source)} points: beside Open3D", measured(pair, scope.cfreg)


def pairs():
    """A procedural relief, and a scan where there are any."""
    rng = np.random.default_rng(7)
    truth = np.eye(4)
    truth[:3, :3], truth[:3, 3] = random_rotation(rng), rng.normal(size=3)
    source = relief(POINTS, rng)
    target = as_f32(relief(POINTS, rng) @ truth[:3, :3].T + truth[:3, 3])
    size = np.linalg.norm(np.ptp(source, axis=0))
    axis = np.radians(DEGREES) * direction(rng)
    error = about(from_vector(axis), target.mean(axis=0))
    error[:3, 3] += SHARE * size * direction(rng)
    yield protocols.StartedPair("relief", "relief", source, target, truth, error @ truth)
    if scans.data_folder() is not None:
        yield next(protocols.real(1, points=POINTS, degrees=DEGREES, share=SHARE))


def measured(pair, cfreg):
    for method in ("icp", "plane-icp"):
        mine, theirs = crate_from(method, pair), open3d_from(METHODS[method], pair)
        who = f"cfreg - open3d, {method}"
        yield "icp: rotation apart, degrees", who, rotation_degrees(mine, theirs)
        yield "icp: translation apart / size", who, centroid_shift(mine, theirs, pair.source)
    found = crate.register(pair.source, pair.target, "icp", initial=pair.initial)
    distance = found.evaluation.max_distance
    yield from evaluated("register", pair, found.transform, distance, found.evaluation)
    for pose in (pair.truth, pair.initial):
        for bound in (0.5 * distance, distance, 4.0 * distance):
            evaluation = cfreg.evaluate(pair.source, pair.target, pose, max_distance=bound)
            yield from evaluated("evaluate", pair, pose, bound, evaluation)


def evaluated(what, pair, pose, distance, evaluation):
    theirs = open3d.evaluated(pair.source, pair.target, distance, pose)
    moved = pair.source @ pose[:3, :3].T + pose[:3, 3]
    nearest, _ = cKDTree(pair.target).query(moved)
    slack = TIE * (distance + np.abs(pair.target).max())
    in_doubt = np.mean(np.abs(nearest - distance) < slack)
    who = f"cfreg - open3d, {what}"
    apart = abs(evaluation.fitness - theirs.fitness)
    yield "evaluation: pairs in doubt, share", who, in_doubt
    yield "evaluation: fitness, beyond pairs in doubt", who, max(apart - in_doubt, 0.0)
    if in_doubt == 0:
        rmse = abs(evaluation.inlier_rmse / theirs.inlier_rmse - 1)
        yield "evaluation: inlier rmse, relative", who, rmse
