"""Closed forms and residuals beside the answer at 50 digits to the very same moments.

An error is judged over the problem's condition: by how much a relative error of the
cross covariance turns the best rotation. Hard problems have a large one, and every
solver's error must stay a few roundings times it.
"""

import numpy as np

import reference as ref
from reference import exact
from reference.exact.numbers import applied, dot, minus, mp, norm
from reference.rotations import random_rotation

PAIRS = 40
SCALES = ("fixed", "umeyama", "symmetric")

ROTATION = "pose: rotation and scale, over the condition"
MEAN = "pose: where the mean goes, relative"
RESIDUAL = "residual from moments, relative to its terms"
NEAR_ONE = "residual, scale within 1e-6 of 1"

BOUNDS = {
    ROTATION: (2e-14, "some hundred roundings of 1e-16, times the condition"),
    MEAN: (2e-15, "some roundings of the coordinates' magnitude"),
    RESIDUAL: (5e-15, "some tens of roundings of terms that cancel"),
    NEAR_ONE: (2e-6, "such a scale counts as 1, so that a rotation keeps its digits"),
}

PROBLEMS = {
    "noise": {"noise": 0.05},
    "much noise": {"noise": 0.5},
    "half a turn": {"degrees": 180.0},
    "no motion": {"degrees": 0.0, "noise": 0.0},
    "scale 1.7": {"scale": 1.7},
    "plane: rank 2": {"shape": (1.0, 0.7, 0.0), "noise": 0.0},
    "plane, scale 3": {"shape": (1.0, 0.7, 0.0), "noise": 0.0, "scale": 3.0},
    "reflection": {"mirror": True},
    "reflection, scale 0.4": {"mirror": True, "scale": 0.4},
    "reflection, s3 of s2: 1 - 1e-3": {"mirror": True, "shape": (1.0, 0.7, 0.69965), "noise": 0.0},
    "reflection, s3 of s2: 1 - 1e-5": {"mirror": True, "shape": (1.0, 0.7, 0.6999965), "noise": 0.0},
    "equal singular values": {"shape": (0.5, 0.5, 0.5), "noise": 0.0},
    "nearly a line: s2 of s1: 1e-4": {"shape": (1.0, 0.01, 0.005), "noise": 0.0},
    "nearly a line: s2 of s1: 1e-6": {"shape": (1.0, 0.001, 0.0005), "noise": 0.0},
    "UTM coordinates": {"origin": (5e5, 5.6e6, 300.0), "unit": 100.0},
    "UTM, reflection": {"origin": (5e5, 5.6e6, 300.0), "unit": 100.0, "mirror": True},
    "tiny unit": {"unit": 1e-6},
    "huge unit": {"unit": 1e6},
}


def sections(scope):
    yield f"poses from equal moments beside {exact.DIGITS} digits", measured(scope.cfreg)


def measured(cfreg):
    for seed, (name, kind) in enumerate(PROBLEMS.items()):
        source, target = pairs(np.random.default_rng(seed), **kind)
        found = ref.moments(np.eye(PAIRS), source, target)
        yield from judged("reference - exact", name, found, Reference)
        if cfreg:
            found = moments_of_pairs(cfreg, source, target)
            yield from judged("cfreg - exact", name, found, Crate(cfreg))


class Reference:
    solve = staticmethod(lambda sums, solver, scale: ref.solve(sums, solver, scale).matrix())

    @staticmethod
    def residual(sums, matrix):
        scale = np.cbrt(np.linalg.det(matrix[:3, :3]))
        return ref.weighted_residual(sums, scale, matrix[:3, :3] / scale, matrix[:3, 3])


class Crate:
    def __init__(self, cfreg):
        self.solve = lambda sums, solver, scale: np.asarray(cfreg.solve(sums, solver=solver, scale=scale))
        self.residual = lambda sums, matrix: sums.residual(matrix)


def moments_of_pairs(cfreg, source, target):
    """Moments of the pairs (i, i) alone: descriptors are numbers, far apart from the next."""
    numbers = np.arange(float(len(source)))[:, None]
    return cfreg.moments(source, target, numbers, numbers, weights="truncated", beta=0.25)


def judged(who, name, found, implementation):
    sums = exact.Sums.from_moments(found)
    spread = mp.sqrt(sums.source_squares * sums.target_squares)
    size = mp.sqrt((sums.source_squares + sums.target_squares) / sums.weight)
    for scale in SCALES:
        true = exact.solve(sums, scale)
        for solver in ref.SOLVERS:
            label = f"{who}, {name}, {solver}, {scale}"
            rows = exact.rows(implementation.solve(found, solver, scale))
            yield ROTATION, label, rotation_error(rows, true) / condition(true, solver, spread)
            yield MEAN, label, mean_error(rows, sums, size)
        for pose in (implementation.solve(found, "arun", scale), far_pose(sums)):
            error = residual_error(implementation.residual(found, pose), pose, sums, size)
            yield NEAR_ONE if is_near_one(pose) else RESIDUAL, f"{who}, {name}, {scale}", error


def is_near_one(pose):
    """Whether the scale differs from 1, by more than rounding and less than the crate minds."""
    return 1e-14 < abs(np.cbrt(np.linalg.det(pose[:3, :3])) - 1.0) < 1e-6


def residual_error(found, pose, sums, size):
    # Sums of f32 products may leave a perfect fit a little below 0; nobody need return that.
    expected = max(exact.residual(sums, exact.rows(pose)), 0)
    return abs(exact.exact(max(found, 0.0)) - expected) / terms(exact.rows(pose), sums, size)


def far_pose(sums):
    """A pose (4, 4) that is far from any answer: half a size off, turned by 50 degrees."""
    pose = np.eye(4)
    pose[:3, :3] = random_rotation(np.random.default_rng(5), degrees=50.0)
    origins = exact.as_float(sums.source_origin), exact.as_float(sums.target_origin)
    half = 0.5 * np.sqrt(exact.as_float((sums.source_squares + sums.target_squares) / sums.weight))
    pose[:3, 3] = origins[1] - pose[:3, :3] @ origins[0] + half
    return pose


def rotation_error(rows, true):
    """Norm of the difference of both matrices, over the scale."""
    wanted = true.matrix()
    differences = (x - y for a, b in zip(rows[:3], wanted[:3]) for x, y in zip(a[:3], b[:3]))
    return mp.sqrt(mp.fsum(x * x for x in differences)) / true.scale


def condition(true, solver, spread):
    """The angle by which a rounding of the cross covariance, relative to the product of the
    clouds' spreads, turns the rotation. Horn's matrix form squares the covariance, and so the condition."""
    first, second, third = true.singular_values
    least = second + third
    return spread * first / (second * least) if solver == "horn-matrix" else spread / least


def mean_error(rows, sums, size):
    """How far off the target's mean the source's comes, over the coordinates' magnitude."""
    p = [o + s / sums.weight for o, s in zip(sums.source_origin, sums.source_sum)]
    q = [o + s / sums.weight for o, s in zip(sums.target_origin, sums.target_sum)]
    moved = [x + row[3] for x, row in zip(applied([row[:3] for row in rows[:3]], p), rows)]
    scale = norm(rows[0][:3])
    return norm(minus(moved, q)) / (scale * norm(p) + norm(q) + size)


def terms(rows, sums, size):
    """The magnitude that rounds in a residual: the squares, and the coordinates' magnitude
    times the size."""
    scale2 = dot(rows[0][:3], rows[0][:3])
    far = mp.sqrt(scale2) * norm(sums.source_origin) + norm(sums.target_origin)
    return scale2 * sums.source_squares + sums.target_squares + sums.weight * size * far


def pairs(
    rng,
    shape=(1.0, 0.7, 0.4),
    noise=0.05,
    degrees=None,
    scale=1.0,
    mirror=False,
    origin=(0.0, 0.0, 0.0),
    unit=1.0,
):
    """Points that belong together, the source's principal deviations being `shape`."""
    source = rng.normal(size=(PAIRS, 3))
    axes, _, _ = np.linalg.svd(source - source.mean(axis=0), full_matrices=False)
    source = np.sqrt(PAIRS) * axes * shape @ random_rotation(rng)
    reflected = source * [1.0, 1.0, -1.0] if mirror else source
    target = scale * reflected @ random_rotation(rng, degrees).T + noise * rng.normal(size=(PAIRS, 3))
    shift = rng.normal(size=3)
    return unit * source + origin, unit * (target + shift) + origin
