"""Normals, curvature and FPFH of small clouds beside 50 digits.

Neighbourhoods from round to nearly flat and nearly straight: the error of a normal is
judged over what rounding can turn it by. Bins are decided exactly; rows behind which some
decision lies within f32 rounding of a tie are counted apart.
"""

import itertools

import numpy as np

import reference as ref
from peers.programs import open3d
from reference import exact
from reference.exact.numbers import cross, dot, mp, norm
from reference.fpfh import SCALES
from reference.rotations import random_rotation
from reference.surfaces import VIEWPOINT, as_f32, relief

POINTS = 20
"""All of a small cloud are one neighbourhood."""
SHAPES = {
    "round": (1.0, 0.8, 0.6),
    "a surface": (1.0, 0.8, 0.1),
    "nearly flat, 1e-3": (1.0, 0.8, 1e-3),
    "nearly flat, 1e-5": (1.0, 0.8, 1e-5),
    "close variances": (1.0, 0.5, 0.4999),
    "nearly straight, 1e-2": (1.0, 1e-2, 1e-3),
    "nearly straight, 1e-4": (1.0, 1e-4, 1e-5),
}
MAP = np.array([500123.5, 5612345.678, 321.0])
REACH = 4.0
"""Greatest coordinate of a small cloud about the crate's origin."""
F32, F64 = 2.0**-24, 2.0**-53
"""Half of what the next number is off, relative."""

NEIGHBORS = 12

BOUNDS = {
    "normal, over what f32 rounding turns": (2.0, "three coordinates of a unit vector in f32"),
    "normal, over what f64 rounding turns": (10.0, "some roundings of the covariance"),
    "curvature, f32": (1e-7, "a number up to 1/3 in f32, and rounded points on a map"),
    "curvature, f64": (1e-14, "some roundings of the covariance"),
    "FPFH, clear rows, L1, f32": (5e-4, "33 sums of some ten f32 numbers up to 200"),
    "FPFH, clear rows, L1, f64": (1e-11, "33 sums of some ten numbers up to 200"),
    "FPFH, rows not clear, share": (0.5, "else too few rows are judged"),
}


def sections(scope):
    yield f"normals of {POINTS} points beside {exact.DIGITS} digits", planes(scope.cfreg)
    yield f"FPFH of small clouds beside {exact.DIGITS} digits, k = {NEIGHBORS}", histograms(scope.cfreg)


def planes(cfreg):
    for seed, (name, shape) in enumerate(SHAPES.items()):
        points = neighbourhood(np.random.default_rng(seed), shape)
        for where, place in (("", np.zeros(3)), ("map: ", MAP)):
            placed = points + place
            estimates = {"reference - exact": (ref.normals(placed, POINTS, place + 9.0), "f64", F64)}
            if cfreg:
                ours = cfreg.estimate_normals(placed, neighbors=POINTS, viewpoint=tuple(place + 9.0))
                estimates["cfreg - exact"] = ours, "f32", F32
            normal, curvature, variances = exact.plane(exact.rows(placed))
            for who, ((normals, curvatures), digits, unit) in estimates.items():
                label = f"{who}, {where}{name}"
                worst = max(angle(found, normal) for found in exact.rows(normals))
                limit = turn(variances, unit, moved=bool(where) and unit == F32)
                yield f"normal, over what {digits} rounding turns", label, worst / limit
                error = max(abs(exact.exact(found) - curvature) for found in curvatures)
                yield f"curvature, {digits}", label, error


def neighbourhood(rng, shape):
    """Points of these principal deviations, f32 numbers."""
    points = rng.normal(size=(POINTS, 3))
    axes, _, _ = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    return as_f32(np.sqrt(POINTS) * axes * shape @ random_rotation(rng))


def angle(a, b):
    """Radians between two lines."""
    return mp.atan2(norm(cross(a, b)), abs(dot(a, b)))


def turn(variances, unit, moved):
    """Radians that rounding turns a normal by: of its own coordinates, of the covariance
    in f64 and, where f32 points have `moved` to a near origin, of these."""
    least, middle, greatest = variances
    gap = middle - least
    tilt = unit * REACH * (mp.sqrt(middle) + mp.sqrt(least)) / gap if moved else 0
    return unit + F64 * greatest / gap + tilt


def histograms(cfreg):
    for (name, points), scale in itertools.product(clouds().items(), SCALES):
        normals = as_f32(ref.normals(points, NEIGHBORS, VIEWPOINT)[0])
        true = exact.fpfh(exact.rows(points), exact.rows(normals), NEIGHBORS, scale)
        found = {"reference - exact": (ref.fpfh(points, normals, NEIGHBORS, scale), "f64")}
        if scale == "open3d":
            found["open3d - exact"] = open3d.fpfh(points, normals, NEIGHBORS), "f64"
        if cfreg:
            ours = cfreg.fpfh(points, neighbors=NEIGHBORS, scale=scale, normals=normals)
            found["cfreg - exact"] = np.asarray(ours, dtype=np.float64), "f32"
        yield "FPFH, pairs within f32 rounding of a tie", f"exact, {name}", true.doubtful_pairs
        yield "FPFH, rows not clear, share", f"exact, {name}", np.mean(~true.clear)
        for who, (values, digits) in found.items():
            apart = np.abs(values - true.histograms).sum(axis=1)
            label = f"{who}, {name}, {scale}"
            yield f"FPFH, clear rows, L1, {digits}", label, apart[true.clear].max()
            if not true.clear.all():
                yield f"FPFH, other rows, L1, {digits}", label, apart[~true.clear].max()


def clouds():
    """A relief, and one with a flat grid beside it, whose last neighbours tie."""
    random = relief(50, np.random.default_rng(31))
    steps = np.arange(5) / 8.0
    grid = np.stack([*np.meshgrid(steps + 3.0, steps), np.zeros((5, 5))], axis=-1).reshape(-1, 3)
    return {"relief": random, "relief and grid": np.vstack([random, grid])}
