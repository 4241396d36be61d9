"""What is measured between two implementations, stage by stage.

Every function yields (quantity, who, value); `compare.py` has a bound for each
quantity that is judged, and prints the others for information. A stage gets the
reference's result of the stage before, rounded to f32, so that it is judged alone.

Two right programs may differ where a decision is a tie in f32: which point is the
k-th, which side the viewpoint is on, which bin. Medians and maxima are therefore
taken over the *clear* points, and their share and what happens elsewhere are
quantities of their own.
"""

from types import SimpleNamespace

import numpy as np

import reference as ref
from reference.fpfh import bin_positions, pair_features
from reference.normals import principal_axes
from surfaces import as_f32
from system_libraries import import_open3d

TIE = 1e-6
"""Relative differences below this, some ten roundings of f32, count as ties."""
DISTANCE_ROUNDING = 2e-2
"""Error of |a|² + |b|² - 2 a.b in f32 for FPFH, at the very worst: five roundings of
|a|² + |b|² <= 6e4, each 6e-8 of it."""
EIGENVALUE_GAP = 1e-3
"""(l1 - l0) / l2 below which a neighbourhood has no distinct normal in f32."""

KERNELS = [name for name in ref.KERNELS if name != "gaussian"]
NORMALISATIONS = ("none", "source", "target", "both", "sinkhorn:10")


def scene(points, viewpoint, k):
    """The reference's view of one cloud, computed once: points, normals in f32,
    descriptors, and which points are clear."""
    normals, curvature = ref.normals(points, k, viewpoint)
    values, _ = principal_axes(points, k)
    towards = viewpoint - points
    side = np.einsum("ij,ij->i", towards, normals) / np.linalg.norm(towards, axis=1)
    neighbourhood = ref.separation(points, k) > TIE
    distinct = values[:, 1] - values[:, 0] > EIGENVALUE_GAP * values[:, 2]
    f32_normals = as_f32(normals)
    return SimpleNamespace(
        points=points,
        viewpoint=viewpoint,
        k=k,
        normals=normals,
        curvature=curvature,
        f32_normals=f32_normals,
        same_neighbours=neighbourhood,
        clear=neighbourhood & distinct & (np.abs(side) > TIE),
        fpfh={scale: ref.fpfh(points, f32_normals, k, scale) for scale in ("pcl", "open3d")},
    )


def ties(s):
    """How much of the cloud is not clear, and why."""
    neighbours = ref.nearest(s.points, s.k)[0][:, 1:]
    n, m = s.f32_normals[:, None], s.f32_normals[neighbours]
    features = pair_features(s.points[:, None], n, s.points[neighbours], m)
    positions = bin_positions(features)
    near_edge = np.abs(positions - np.round(positions)) < TIE * 11
    yield "points with a tie for the last neighbour, share", "reference", np.mean(~s.same_neighbours)
    yield "points not clear for another reason, share", "reference", np.mean(s.same_neighbours & ~s.clear)
    yield "pair features within f32 rounding of a bin's edge, share", "reference", near_edge.mean()
    yield "pairs with equal normals, share", "reference", (n == m).all(axis=2).mean()


def normals(s, cfreg):
    o3d = import_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(s.points))
    search = o3d.geometry.KDTreeSearchParamKNN(s.k)
    # The fast way solves a cubic and loses digits where eigenvalues are close.
    cloud.estimate_normals(search, fast_normal_computation=False)
    cloud.orient_normals_towards_camera_location(s.viewpoint)
    found = {"open3d - reference": np.asarray(cloud.normals)}
    if cfreg:
        estimated, curvature = cfreg.estimate_normals(
            s.points, neighbors=s.k, viewpoint=tuple(s.viewpoint)
        )
        found["cfreg - reference"] = np.asarray(estimated, dtype=np.float64)
        difference = np.abs(np.asarray(curvature, dtype=np.float64) - s.curvature)
        yield "curvature, max", "cfreg - reference", difference[s.same_neighbours].max()
    for who, vectors in found.items():
        angle = angles(vectors, s.normals)
        yield "normal angle, median, degrees", who, np.median(angle[s.clear])
        yield "normal angle, max, degrees", who, angle[s.clear].max()
        yield "normal angle, max with ties, degrees", who, angle.max()


def descriptors(s, cfreg):
    o3d = import_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(s.points))
    cloud.normals = o3d.utility.Vector3dVector(s.f32_normals)
    search = o3d.geometry.KDTreeSearchParamKNN(s.k)
    theirs = o3d.pipelines.registration.compute_fpfh_feature(cloud, search).data.T
    pairs = {("open3d", "open3d - reference"): (theirs, s.fpfh["open3d"])}
    if cfreg:
        for scale in ("pcl", "open3d"):
            ours = cfreg.fpfh(s.points, neighbors=s.k, scale=scale, normals=s.f32_normals)
            ours = np.asarray(ours, dtype=np.float64)
            pairs[scale, "cfreg - reference"] = (ours, s.fpfh[scale])
        pairs["open3d", "cfreg - open3d"] = (ours, theirs)
        own = cfreg.fpfh(s.points, neighbors=s.k, scale="pcl", viewpoint=tuple(s.viewpoint))
        apart = np.abs(np.asarray(own, dtype=np.float64) - s.fpfh["pcl"]).sum(axis=1)
        what = "FPFH pcl from own normals"
        yield f"{what}, L1 of 300, median", "cfreg - reference", np.median(apart[s.clear])
        yield f"{what}, share of points > 1", "cfreg - reference", np.mean(apart[s.clear] > 1.0)
    for (scale, who), (a, b) in pairs.items():
        total = {"pcl": 300, "open3d": 600}[scale]
        apart = np.abs(a - b).sum(axis=1)
        yield f"FPFH {scale}, L1 of {total}, median", who, np.median(apart[s.same_neighbours])
        yield f"FPFH {scale}, L1 of {total}, max", who, apart[s.same_neighbours].max()
        yield f"FPFH {scale}, L1 of {total}, max with ties", who, apart.max()
        yield f"FPFH {scale}, share of points > 1", who, np.mean(apart[s.same_neighbours] > 1.0)


def sums(a, b, size, cfreg, beta):
    """Moments of the crate beside the reference's about the crate's origins, from the
    same descriptors, for the Gaussian under every normalisation and every kernel
    without; then the poses that follow. The truncated kernel jumps, so that its sums
    may change by the pairs whose side f32 does not decide, and no more."""
    schemes = [("gaussian", name) for name in NORMALISATIONS] + [(name, "none") for name in KERNELS]
    features = [as_f32(s.fpfh["pcl"]) for s in (a, b)]
    d2 = ref.squared_distances(*features)
    for kernel, normalisation in schemes:
        theirs = cfreg.moments(
            a.points,
            b.points,
            *(f.astype(np.float32) for f in features),
            weights=kernel,
            beta=beta,
            normalize=normalisation,
        )
        weights = ref.normalise(ref.weigh(d2, kernel, beta), normalisation)
        origins = np.asarray(theirs.source_origin), np.asarray(theirs.target_origin)
        ours = ref.moments(weights, a.points, b.points, *origins)
        apart = moments_apart(theirs, ours, size)
        label = f"cfreg - reference, {kernel}, {normalisation}"
        if kernel == "truncated":
            in_doubt = np.count_nonzero(np.abs(d2 - beta) < DISTANCE_ROUNDING)
            change = max(abs(theirs.weight - ours.weight), apart * ours.weight)
            yield "truncated: pairs in doubt, share of the weight", label, in_doubt / ours.weight
            yield "truncated: change of a sum per pair in doubt", label, change / max(in_doubt, 1)
            continue
        yield "sum of weights, relative", label, relative(theirs.weight, ours.weight)
        squared = relative(theirs.weight_squared, ours.weight_squared)
        yield "sum of squared weights, relative", label, squared
        yield "moments, relative to size", label, apart
        if kernel == "gaussian":
            yield from poses(theirs, ours, size, cfreg, label)


def poses(theirs, ours, size, cfreg, label):
    same = ref.Moments(**{name: np.asarray(getattr(theirs, name)) for name in vars(ours)})
    for solver in ref.SOLVERS:
        for scale in ("fixed", "umeyama"):
            matrix = np.asarray(cfreg.solve(theirs, solver=solver, scale=scale))
            who = f"{label}, {solver}, scale {scale}"
            alone = ref.solve(same, solver, scale).matrix()
            yield "pose from equal moments, difference", who, pose_apart(matrix, alone, size)[2]
            angle, shift, _ = pose_apart(matrix, ref.solve(ours, solver, scale).matrix(), size)
            yield "pose, rotation, degrees", who, angle
            yield "pose, translation / size", who, shift


def registration(a, b, size, cfreg, beta):
    """From clouds to pose at once, both seen from the origin."""
    result = cfreg.register(a, b, neighbors=ref.NEIGHBORS, beta=beta)
    expected = ref.register(a, b, ref.NEIGHBORS, beta).matrix()
    angle, shift, _ = pose_apart(np.asarray(result.transform), expected, size)
    yield "register, rotation, degrees", "cfreg - reference", angle
    yield "register, translation / size", "cfreg - reference", shift


def moments_apart(a, b, size):
    """The largest difference of any moment, each relative to the sum of weights and
    as many factors `size` as it has lengths."""
    return max(
        np.abs(np.asarray(getattr(a, name)) - getattr(b, name)).max() / (b.weight * size**power)
        for name, power in (
            ("source_sum", 1),
            ("target_sum", 1),
            ("cross", 2),
            ("source_squares", 2),
            ("target_squares", 2),
        )
    )


def pose_apart(a, b, size):
    """Between two (4, 4) similarities: angle in degrees, translation over `size`, and
    the largest difference of an entry with lengths over `size`."""
    r, s = (m[:3, :3] / np.cbrt(np.linalg.det(m[:3, :3])) for m in (a, b))
    turn = r @ s.T
    sine = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    angle = np.degrees(np.arctan2(np.linalg.norm(sine), np.trace(turn) - 1.0))
    shift = np.linalg.norm(a[:3, 3] - b[:3, 3]) / size
    return angle, shift, max(np.abs(a - b)[:3, :3].max(), shift)


def angles(a, b):
    """Angles (N,) between unit vectors (N, 3) in degrees, exact for small ones."""
    sine = np.linalg.norm(np.cross(a, b), axis=1)
    return np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", a, b)))


def relative(a, b):
    return abs(a - b) / abs(b)
