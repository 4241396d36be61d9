"""The ICP family beside Open3D and small_gicp on real scans, and beside PCL on the
paper's protocols.

On scans every method starts from the same wrong pose, with the same points, the same
longest pair and normals of 20 neighbours; found is within 10 degrees and 5 % of the
size. On the paper's protocols both run with the paper's settings; found is the same, the
errors are the paper's own: the norm of I - R R_true^T (section IV-D), the mean distance of
points that belong together (section IV-C).
"""

import importlib.util
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import scans
from pcl.programs import build
from peers import clouds, ours
from peers.table import difference, errors, successes, told

METHODS = {"icp": "point", "plane-icp": "plane", "gicp": "generalized"}
BOUND = 0.05
"""Longest pair, of the source's size: what 4 degrees and 1 % of the size can make."""
NEIGHBORS = 20
ITERATIONS = 200
REST = 1e-6
"""Radians, and share of the size."""
PAPER = ("0.5", "1000", "1e-9", "0.05")
"""Longest pair, iterations, transformation and Euclidean fitness epsilon (section IV-A)."""


def rows(scope):
    yield from on_scans(scope)
    yield from on_the_papers_protocols(scope)


def on_scans(scope):
    step, points = (60, 1000) if scope.smoke else (8, 4000)
    pairs = list(clouds.real(step, points=points))
    if not pairs:
        return
    where = f"{len(pairs)} scans, {points} points"
    for method in METHODS:
        found = [ours_from(method, pair) for pair in pairs]
        for peer, align in peers().items():
            theirs = [align(METHODS[method], pair) for pair in pairs]
            yield from compared(method, peer, where, pairs, found, theirs, TURN_AND_SHIFT)


def peers():
    """Functions of a metric and a pair to a pose, by name, of those that are installed."""
    found = {"open3d": ("Open3D", open3d_from), "small_gicp": ("small_gicp", small_gicp_from)}
    for package in list(found):
        if importlib.util.find_spec(package) is None:
            print(f"left out: {found.pop(package)[0]} is not installed")
    return dict(found.values())


def ours_from(method, pair):
    bound = BOUND * pair.size()
    found = ours.register(
        pair.source, pair.target, method, initial=pair.initial, max_distance=bound
    )
    return found.transform


def open3d_from(metric, pair):
    o3d = scans.import_open3d()
    registration = o3d.pipelines.registration
    source, target = (
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(p)) for p in (pair.source, pair.target)
    )
    criteria = registration.ICPConvergenceCriteria(1e-9, 1e-9, ITERATIONS)
    arguments = source, target, BOUND * pair.size(), pair.initial
    if metric == "generalized":
        # Its own discs: 20 neighbours, thickness 1e-3.
        estimation = registration.TransformationEstimationForGeneralizedICP()
        found = registration.registration_generalized_icp(*arguments, estimation, criteria)
        return found.transformation
    if metric == "plane":
        target.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBORS))
        estimation = registration.TransformationEstimationPointToPlane()
    else:
        estimation = registration.TransformationEstimationPointToPoint()
    return registration.registration_icp(*arguments, estimation, criteria).transformation


def small_gicp_from(metric, pair):
    import small_gicp

    source, target = (small_gicp.PointCloud(points) for points in (pair.source, pair.target))
    for cloud in (source, target):
        small_gicp.estimate_normals_covariances(cloud, num_neighbors=NEIGHBORS)
    return small_gicp.align(
        target,
        source,
        init_T_target_source=pair.initial,
        registration_type={"point": "ICP", "plane": "PLANE_ICP", "generalized": "GICP"}[metric],
        max_correspondence_distance=BOUND * pair.size(),
        max_iterations=ITERATIONS,
        rotation_epsilon=REST,
        translation_epsilon=REST * pair.size(),
    ).T_target_source


def on_the_papers_protocols(scope):
    program = build("icp")
    if program is None:
        print("left out: PCL is not installed")
        return
    if scans.data_folder() is None:
        print("left out: the paper's protocols (CFREG_DATA and ../shared/data are absent)")
        return
    trials = 10 if scope.smoke else 100
    for protocol, quantity in (
        (clouds.accuracy, {"|I - R Rt|": lambda pose, pair: ours.frobenius(pose, pair.truth)}),
        (clouds.robustness, {"mean shift": mean_shift}),
    ):
        for large in (False, True):
            pairs = list(protocol("bunny", trials, large))
            where = f"{pairs[0].kind} bunny {'large' if large else 'small'}"
            found = [ours.register(p.source, p.target, "icp-paper") for p in pairs]
            poses, theirs, iterations = [f.transform for f in found], *pcl(program, pairs)
            yield from compared("icp-paper", "PCL", where, pairs, poses, theirs, quantity)
            steps = np.mean([f.iterations for f in found]), np.mean(iterations)
            yield told("icp-paper", "PCL", where, "mean iterations", *steps)


def pcl(program, pairs):
    """PCL's poses and iterations."""
    with tempfile.TemporaryDirectory() as folder:
        lines = []
        for number, pair in enumerate(pairs):
            names = [Path(folder) / f"{number}{side}" for side in "ab"]
            for name, points in zip(names, (pair.source, pair.target)):
                np.savetxt(name, points, fmt="%.9g")
            lines.append(" ".join(map(str, names)))
        listed = Path(folder) / "pairs"
        listed.write_text("\n".join(lines) + "\n")
        run = subprocess.run([program, listed, *PAPER], check=True, capture_output=True, text=True)
    table = np.array([[float(x) for x in line.split()] for line in run.stdout.splitlines()])
    return list(table[:, :16].reshape(-1, 4, 4)), table[:, 16]


def mean_shift(pose, pair):
    """Mean distance of the source points, moved, to the same points in the target."""
    moved = pair.source @ pose[:3, :3].T + pose[:3, 3]
    return float(np.linalg.norm(moved - pair.target[: len(moved)], axis=1).mean())


TURN_AND_SHIFT = {
    "rotation error, deg": lambda pose, pair: ours.angle(pose, pair.truth),
    "translation error / size": lambda pose, pair: ours.shift(pose, pair.truth, pair.source),
}


def is_right(pose, pair):
    turn, shift = ours.angle(pose, pair.truth), ours.shift(pose, pair.truth, pair.source)
    return turn < 10.0 and shift < 0.05


def compared(method, peer, where, pairs, found, theirs, quantities):
    """How many are found, the median errors of all, and how far apart the poses are."""
    right = (sum(is_right(t, p) for t, p in zip(poses, pairs)) for poses in (found, theirs))
    yield successes(method, peer, where, *right, len(pairs))
    for quantity, error in quantities.items():
        medians = (np.median([error(t, p) for t, p in zip(ts, pairs)]) for ts in (found, theirs))
        yield errors(method, peer, where, f"median {quantity}", *medians)
    apart = [ours.angle(a, b) for a, b in zip(found, theirs)]
    yield difference(method, peer, where, "apart, deg, median", np.median(apart))
    yield difference(method, peer, where, "apart, deg, 90 %", np.quantile(apart, 0.9))
