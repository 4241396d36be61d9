"""The ICP family beside Open3D and small_gicp on real scans, and beside PCL on the
paper's protocols.

On scans every method starts from the same wrong pose, with the same points, the same
longest pair and normals of 20 neighbours; found is within 10 degrees and 5 % of the
size. On the paper's protocols both run with the paper's settings; found is the same, the
errors are the paper's own: the norm of I - R R_true^T (section IV-D), the mean distance of
points that belong together (section IV-C).
"""

import numpy as np

from peers.methods import protocols
from peers.methods.rule_table import difference, errors, successes, figures
from peers.programs import crate, left_out, open3d, pcl, small_gicp
from reference import scans
from reference.pose_error import centroid_shift, frobenius, rotation_degrees

METHODS = {"icp": "point", "plane-icp": "plane", "gicp": "generalized"}
MAX_DISTANCE_SHARE = 0.05
"""Longest pair, of the source's size: what 4 degrees and 1 % of the size can make."""
NEIGHBORS = 20
MAX_ITERATIONS = 200
TOLERANCE = 1e-6
"""Radians, and share of the size."""
PAPER_SETTINGS = ("0.5", "1000", "1e-9", "0.05")
"""Longest pair, iterations, transformation and Euclidean fitness epsilon (section IV-A)."""


def rows(scope):
    yield from on_scans(scope)
    yield from on_the_papers_protocols(scope)


def on_scans(scope):
    step, points = (60, 1000) if scope.smoke else (8, 4000)
    pairs = list(protocols.real(step, points=points))
    if not pairs:
        return
    where = f"{len(pairs)} scans, {points} points"
    for method in METHODS:
        found = [crate_from(method, pair) for pair in pairs]
        for peer, align in peers().items():
            theirs = [align(METHODS[method], pair) for pair in pairs]
            yield from compared(method, peer, where, pairs, found, theirs, TURN_AND_SHIFT)


def peers():
    """Functions of a metric and a pair to a pose, by name, of those that are installed."""
    found = {"open3d": ("Open3D", open3d_from), "small_gicp": ("small_gicp", small_gicp_from)}
    return dict(peer for package, peer in found.items() if not left_out(peer[0], package))


def crate_from(method, pair):
    bound = MAX_DISTANCE_SHARE * pair.size()
    found = crate.register(
        pair.source, pair.target, method, initial=pair.initial, max_distance=bound
    )
    return found.transform


def open3d_from(metric, pair):
    settings = {"initial": pair.initial, "max_iterations": MAX_ITERATIONS, "neighbors": NEIGHBORS}
    bound = MAX_DISTANCE_SHARE * pair.size()
    return open3d.iterative_closest_point(metric, pair.source, pair.target, bound, **settings)


def small_gicp_from(metric, pair):
    return small_gicp.register(
        metric,
        pair.source,
        pair.target,
        max_distance=MAX_DISTANCE_SHARE * pair.size(),
        initial=pair.initial,
        neighbors=NEIGHBORS,
        max_iterations=MAX_ITERATIONS,
        rotation_tolerance=TOLERANCE,
        translation_tolerance=TOLERANCE * pair.size(),
    )


def on_the_papers_protocols(scope):
    if pcl.program("icp") is None:
        return
    if scans.data_folder() is None:
        print("left out: the paper's protocols (CFREG_DATA and ../shared/data are absent)")
        return
    trials = 10 if scope.smoke else 100
    for protocol, quantity in (
        (protocols.accuracy, {"|I - R Rt|": lambda pose, pair: frobenius(pose, pair.truth)}),
        (protocols.robustness, {"mean shift": shift_of_the_same_points}),
    ):
        for large in (False, True):
            pairs = list(protocol("bunny", trials, large))
            where = f"{pairs[0].kind} bunny {'large' if large else 'small'}"
            found = [crate.register(p.source, p.target, "icp-paper") for p in pairs]
            poses = [f.transform for f in found]
            theirs, iterations = pcl.iterative_closest_point(((p.source, p.target) for p in pairs), PAPER_SETTINGS)
            yield from compared("icp-paper", "PCL", where, pairs, poses, theirs, quantity)
            steps = np.mean([f.iterations for f in found]), np.mean(iterations)
            yield figures("icp-paper", "PCL", where, "mean iterations", *steps)


def shift_of_the_same_points(pose, pair):
    """Mean distance of the source points, moved, to the same points in the target."""
    moved = pair.source @ pose[:3, :3].T + pose[:3, 3]
    return float(np.linalg.norm(moved - pair.target[: len(moved)], axis=1).mean())


TURN_AND_SHIFT = {
    "rotation error, deg": lambda pose, pair: rotation_degrees(pose, pair.truth),
    "translation error / size": lambda pose, pair: centroid_shift(pose, pair.truth, pair.source),
}


def is_right(pose, pair):
    turn, shift = rotation_degrees(pose, pair.truth), centroid_shift(pose, pair.truth, pair.source)
    return turn < 10.0 and shift < 0.05


def compared(method, peer, where, pairs, found, theirs, quantities):
    """How many are found, the median errors of all, and how far apart the poses are."""
    right = (sum(is_right(t, p) for t, p in zip(poses, pairs)) for poses in (found, theirs))
    yield successes(method, peer, where, *right, len(pairs))
    for quantity, error in quantities.items():
        medians = (np.median([error(t, p) for t, p in zip(ts, pairs)]) for ts in (found, theirs))
        yield errors(method, peer, where, f"median {quantity}", *medians)
    apart = [rotation_degrees(a, b) for a, b in zip(found, theirs)]
    yield difference(method, peer, where, "apart, deg, median", np.median(apart))
    yield difference(method, peer, where, "apart, deg, 90 %", np.quantile(apart, 0.9))
