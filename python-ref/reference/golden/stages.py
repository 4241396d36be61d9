"""The stages of one registration: kernels, weights, moments, closed forms, features.

The seed of the surface pair is the first whose every decision (which neighbour, which
bin, which side, inside the truncation or not) is clear of f32 rounding.
"""

import itertools

import numpy as np

import reference as ref
from reference.fpfh import bin_positions, pair_features
from reference.scans import relief_pair
from reference.rotations import random_rotation
from reference.surfaces import as_f32

POINTS = 120
NEIGHBORS = 30
WIDE_BETA = 1000.0
"""A bandwidth under which clouds as small as these still have many connections."""
NU = 5.0
NORMALISATIONS = ("none", "source", "target", "both", "sinkhorn:10")

MARGINS = {
    "neighbour": 5e-5,  # relative gap of d² between the last neighbour and the next
    "side": 1e-2,  # |cosine| of normal and direction to the viewpoint
    "bin": 5e-5,  # distance to the next edge, in widths of a bin
    "first point": 5e-6,  # difference of |cosines| that decide the order of a pair
    "truncation": 0.05,  # |d² - beta|
}
"""How far from a tie each decision of the surface pair is, at least."""


def cases():
    pair = next(filter(is_clear, (relief_pair(POINTS, seed) for seed in itertools.count())))
    return {
        "surface_pair": surface_pair(pair),
        "weights": weights_case(pair),
        "point_weights": point_weights_case(pair),
        "solve": solve_case(),
        "kernels": kernels_case(),
    }


def surface_pair(pair):
    """Everything from two clouds to poses: normals, FPFH, moments."""
    given = {
        "neighbors": NEIGHBORS,
        "source": {"points": pair.source, "viewpoint": pair.source_viewpoint},
        "target": {"points": pair.target, "viewpoint": pair.target_viewpoint},
    }
    expected = {
        "true_rotation": pair.rotation,
        "true_translation": pair.translation,
        "source": stages_of_cloud(pair.source, pair.source_viewpoint),
        "target": stages_of_cloud(pair.target, pair.target_viewpoint),
        "registrations": [],
    }
    for scale, beta in (("pcl", ref.BETA), ("pcl", WIDE_BETA), ("open3d", 4.0 * WIDE_BETA)):
        descriptors = (as_f32(expected[side][f"fpfh_{scale}"]) for side in ("source", "target"))
        weights = ref.weigh(ref.squared_distances(*descriptors), "gaussian", beta)
        sums = ref.moments(weights, pair.source, pair.target)
        solved = {"scale": scale, "beta": beta, **sums_and_pose(sums)}
        expected["registrations"].append(solved)
    return given, expected


def stages_of_cloud(points, viewpoint):
    normals, curvature = ref.normals(points, NEIGHBORS, viewpoint)
    return {
        "neighbours": ref.nearest(points, NEIGHBORS)[0],
        "normals": normals,
        "curvature": curvature,
        "fpfh_pcl": ref.fpfh(points, as_f32(normals), NEIGHBORS, "pcl"),
        "fpfh_open3d": ref.fpfh(points, as_f32(normals), NEIGHBORS, "open3d"),
    }


def weights_case(pair):
    """Every kernel with every normalisation, from f32 descriptors."""
    source, target = descriptors_of(pair)
    given = {
        "beta": WIDE_BETA,
        "nu": NU,
        "source": {"points": pair.source, "descriptors": source},
        "target": {"points": pair.target, "descriptors": target},
    }
    d2 = ref.squared_distances(source, target)
    expected = []
    for kernel, normalisation in itertools.product(ref.KERNELS, NORMALISATIONS):
        weights = ref.normalise(ref.weigh(d2, kernel, WIDE_BETA, NU), normalisation)
        sums = ref.moments(weights, pair.source, pair.target)
        scheme = {"kernel": kernel, "normalisation": normalisation}
        expected.append({**scheme, **sums_and_pose(sums)})
    return given, expected


def point_weights_case(pair):
    """The Gaussian with every normalisation, beside weights of the points, some of them 0."""
    source, target = descriptors_of(pair)
    rng = np.random.default_rng(5)
    own = [as_f32(np.maximum(rng.uniform(-0.5, 3.0, POINTS), 0.0)) for _ in range(2)]
    given = {"beta": WIDE_BETA, "source_weights": own[0], "target_weights": own[1]}
    d2 = ref.squared_distances(source, target)
    expected = []
    for normalisation in NORMALISATIONS:
        weights = ref.normalise(ref.weigh(d2, "gaussian", WIDE_BETA), normalisation)
        sums = ref.moments(
            weights, pair.source, pair.target, source_weights=own[0], target_weights=own[1]
        )
        expected.append({"normalisation": normalisation, **sums_and_pose(sums)})
    return given, expected


def solve_case():
    """Moments of 40 weighted pairs each, and the pose with and without scale."""
    kinds = {
        "noise": {"noise": 0.05},
        "much noise": {"noise": 0.5},
        "half a turn": {"degrees": 180.0},
        "no motion": {"degrees": 0.0, "noise": 0.0},
        "scale 1.7": {"scale": 1.7},
        "mirrored: negative determinant": {"mirror": True},
        "mirrored, scale 0.4": {"mirror": True, "scale": 0.4},
        "plane: rank 2": {"flat": True, "noise": 0.0},
        "plane, scale 3": {"flat": True, "noise": 0.0, "scale": 3.0},
        "origins far away": {"origin": 5e5},
        "clouds far from their origins": {"offset": 1e3},
        "tiny unit": {"unit": 1e-4},
        "huge unit": {"unit": 1e4},
        "line: singular": {"line": True, "noise": 0.0},
        "no weight: singular": {"weight": 0.0},
    }
    given, expected = [], []
    for seed, (name, kind) in enumerate(kinds.items()):
        sums = random_moments(np.random.default_rng(seed), **kind)
        given.append({"name": name, "moments": vars(sums)})
        expected.append({"name": name, "rigid": pose(sums), "similarity": pose(sums, "umeyama")})
    return given, expected


def random_moments(
    rng,
    noise=0.05,
    degrees=None,
    scale=1.0,
    mirror=False,
    flat=False,
    line=False,
    origin=0.0,
    offset=0.0,
    unit=1.0,
    weight=1.0,
):
    shape = [1.0, 0.0 if line else 0.7, 0.0 if line or flat else 0.4]
    source = rng.normal(size=(40, 3)) * shape
    reflected = source * [1.0, 1.0, -1.0] if mirror else source
    target = scale * reflected @ random_rotation(rng, degrees).T + noise * rng.normal(size=(40, 3))
    source, target = unit * (source + offset), unit * (target - offset)
    weights = weight * np.diag(rng.random(40) + 0.1)
    origins = origin + rng.normal(size=(2, 3)) if origin else np.zeros((2, 3))
    return ref.moments(weights, source + origins[0], target + origins[1], *origins)


def kernels_case():
    """Weights at a list of squared distances, for a few bandwidths."""
    d2 = [0.0, 1e-6, 0.5, 1.0, 9.0, 50.0, 99.0, 101.0, 150.0, 400.0, 999.0, 2500.0, 1e4, 1e5]
    expected = [
        {"kernel": kernel, "beta": beta, "nu": NU, "weights": ref.weigh(d2, kernel, beta, NU)}
        for kernel, beta in itertools.product(ref.KERNELS, (1.0 / 3.0, ref.BETA, WIDE_BETA))
    ]
    return {"squared_distances": d2}, expected


# --- their parts -------------------------------------------------------------------


def descriptors_of(pair):
    """f32 descriptors of source and target, PCL's scale, from f32 normals."""
    for points, viewpoint in (
        (pair.source, pair.source_viewpoint),
        (pair.target, pair.target_viewpoint),
    ):
        normals = as_f32(ref.normals(points, NEIGHBORS, viewpoint)[0])
        yield as_f32(ref.fpfh(points, normals, NEIGHBORS, "pcl"))


def sums_and_pose(sums):
    return {
        "moments": vars(sums),
        "effective_connections": ref.effective_connections(sums),
        "pose": pose(sums),
    }


def pose(sums, scale="fixed"):
    """Scale, rotation, translation and residual by Arun's solver, and how far the
    other three are from it; None where the rotation is not unique."""
    try:
        found = {solver: ref.solve(sums, solver, scale) for solver in ref.SOLVERS}
    except ref.SingularError:
        return None
    best = found["arun"]
    return {
        "scale": best.scale,
        "rotation": best.rotation,
        "translation": best.translation,
        "residual": ref.weighted_residual(sums, best.scale, best.rotation, best.translation),
        "solvers_differ_by": max(
            np.abs(other.matrix() - best.matrix()).max() for other in found.values()
        ),
    }


def is_clear(pair):
    """Whether rounding to f32 changes no decision anywhere in the pair, and the
    paper's bandwidth leaves a pose."""
    for points, viewpoint in (
        (pair.source, pair.source_viewpoint),
        (pair.target, pair.target_viewpoint),
    ):
        normals = as_f32(ref.normals(points, NEIGHBORS, viewpoint)[0])
        towards = viewpoint - points
        side = np.einsum("ij,ij->i", towards, normals) / np.linalg.norm(towards, axis=1)
        neighbours = ref.nearest(points, NEIGHBORS)[0][:, 1:]
        p, n, q, m = points[:, None], normals[:, None], points[neighbours], normals[neighbours]
        positions = bin_positions(pair_features(p, n, q, m))
        line = (q - p) / np.linalg.norm(q - p, axis=2, keepdims=True)
        order = np.abs((n * line).sum(axis=2)) - np.abs((m * line).sum(axis=2))
        # Equal normals tie in any arithmetic, and a tie keeps the order.
        order = np.abs(order[(n != m).any(axis=2)])
        clear = (
            ref.separation(points, NEIGHBORS).min() > MARGINS["neighbour"]
            and np.abs(side).min() > MARGINS["side"]
            and np.abs(positions - np.round(positions)).min() > MARGINS["bin"]
            and order.min() > MARGINS["first point"]
        )
        if not clear:
            return False
    d2 = ref.squared_distances(*descriptors_of(pair))
    if np.abs(d2 - WIDE_BETA).min() <= MARGINS["truncation"]:
        return False
    return pose(ref.moments(ref.weigh(d2, "gaussian", ref.BETA), pair.source, pair.target)) is not None
