"""Normals and descriptors of two implementations, from the same input.

A stage gets the reference's result of the stage before, rounded to f32, so that it is
judged alone.

Two right programs may differ where a decision is a tie in f32: which point is the
k-th, which side the viewpoint is on, which bin. Medians and maxima are therefore
taken over the *clear* points, and their share and what happens elsewhere are
quantities of their own.
"""

from types import SimpleNamespace

import numpy as np

import reference as ref
from peers.programs import open3d
from reference.fpfh import bin_positions, pair_features
from reference.normals import principal_axes
from reference.surfaces import as_f32

TIE = 1e-6
"""Relative differences below this, some ten roundings of f32, count as ties."""
EIGENVALUE_GAP = 1e-3
"""(l1 - l0) / l2 below which a neighbourhood has no distinct normal in f32."""

BOUNDS = {
    "normal angle, median, degrees": (1e-5, "f32 normals: a rounding is 3e-6 degrees"),
    "normal angle, max, degrees": (3e-3, "the same, up to 1000 times by close eigenvalues"),
    "curvature, max": (1e-6, "a number up to 1/3 in f32"),
    "FPFH pcl, L1 of 300, median": (1e-3, "the same pairs in the same bins, summed in f32"),
    "FPFH open3d, L1 of 600, median": (1e-3, "the same pairs in the same bins, summed in f32"),
    "FPFH pcl, share of points > 1": (1e-3, "few pairs lie within f32 rounding of an edge"),
    "FPFH open3d, share of points > 1": (1e-3, "few pairs lie within f32 rounding of an edge"),
    "FPFH pcl from own normals, L1 of 300, median": (5e-3, "f32 normals differ in the last bit"),
}


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
    found = {"open3d - reference": open3d.normals(s.points, s.k, s.viewpoint)}
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
    theirs = open3d.fpfh(s.points, s.f32_normals, s.k)
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


def angles(a, b):
    """Angles (N,) between unit vectors (N, 3) in degrees, exact for small ones."""
    sine = np.linalg.norm(np.cross(a, b), axis=1)
    return np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", a, b)))
