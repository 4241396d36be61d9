"""Moments of small full connections beside the same sums at 50 digits: every kernel with
every normalisation, descriptors of 33 and of 3 numbers (the crate computes their
distances in two ways), and map coordinates given as decimal text."""

import itertools
from dataclasses import dataclass

import numpy as np

import reference as ref
from reference import exact
from reference.exact.moments import squared_distances
from reference.exact.numbers import minus
from reference.rotations import random_rotation
from reference.surfaces import VIEWPOINT, as_f32, relief

SOURCE, TARGET = 40, 30
NEIGHBORS = 12
NU = ("5", "1")
NORMALISATIONS = ("none", "source", "target", "both", "sinkhorn:3")

F32 = "weights in f32, 6e-8 each, of distances in f32"
MAP_F32 = F32 + "; points about a near origin in f32"
F64 = "some tens of roundings of 1e-16 in d², kernel and sums"
MAP_F64 = "5.6e6 m in f64 is off by 5e-10 m, the clouds are 2e2 m"

BOUNDS = {
    "sum of weights, f32": (1e-6, F32),
    "sum of squared weights, f32": (2e-6, "twice that of the weights"),
    "moments / size, f32": (1e-6, F32),
    "residual of a pose, f32": (1e-6, F32),
    "map: moments / size, f32": (1e-6, MAP_F32),
    "map: residual of a pose, f32": (1e-6, MAP_F32),
    "sum of weights, f64": (2e-14, F64),
    "sum of squared weights, f64": (4e-14, "twice that of the weights"),
    "moments / size, f64": (2e-14, F64),
    "residual of a pose, f64": (2e-14, F64),
    "map: moments / size, f64": (2e-11, MAP_F64),
    "map: residual of a pose, f64": (2e-11, MAP_F64),
}


@dataclass(frozen=True)
class Connection:
    name: str
    source: list
    """Exact points, rows; the f64 nearest to them is what the implementations get."""
    target: list
    descriptors: tuple
    """f32 numbers in f64, (N, D) and (M, D)."""
    prefix: str = ""
    """Begins the names of quantities that depend on the points."""

    def points(self):
        return exact.as_float(self.source), exact.as_float(self.target)


def sections(scope):
    title = f"moments of {SOURCE} x {TARGET} connections beside {exact.DIGITS} digits"
    yield title, (row for connection in connections() for row in measured(connection, scope.cfreg))


def connections():
    rng = np.random.default_rng(21)
    source, target = relief(SOURCE, rng), relief(TARGET, rng)
    features = tuple(map(descriptors, (source, target)))
    of_places = exact.rows(source), exact.rows(target)
    yield Connection("33 bins", *of_places, features)
    yield Connection("3 numbers", *of_places, (source, target))
    maps = (on_a_map(cloud, corner) for cloud, corner in ((source, 500123.5), (target, 500987.25)))
    yield Connection("map", *maps, features, "map: ")


def descriptors(points):
    normals = as_f32(ref.normals(points, NEIGHBORS, VIEWPOINT)[0])
    return as_f32(ref.fpfh(points, normals, NEIGHBORS))


def on_a_map(points, east):
    """Points in metres to the millimetre in a UTM zone, as decimal text says them."""
    place = 100.0 * points + [east, 5_612_345.678, 321.0]
    return exact.rows([[f"{x:.3f}" for x in row] for row in place])


def measured(connection, cfreg):
    d2 = squared_distances(*map(exact.rows, connection.descriptors))
    beta = clear_bandwidth(exact.as_float(d2))
    given = *connection.points(), *connection.descriptors
    pose = near_pose(*connection.points())
    for (name, kernel, nu), normalisation in itertools.product(kernels(), NORMALISATIONS):
        table = exact.weights(d2, kernel, beta, nu, normalisation)
        label = f"{connection.name}, {name}, {normalisation}"
        found = by_reference(given, kernel, beta, nu, normalisation)
        for quantity, value in differences(found, table, connection, pose):
            yield f"{quantity}, f64", f"reference - exact, {label}", value
        if cfreg:
            found = cfreg.moments(*given, weights=name, beta=beta, normalize=normalisation)
            for quantity, value in differences(found, table, connection, pose):
                yield f"{quantity}, f32", f"cfreg - exact, {label}", value


def kernels():
    """Name in the catalogue, kernel and nu."""
    for kernel in ref.KERNELS:
        for nu in NU if kernel == "student-t" else NU[:1]:
            yield f"{kernel}:{nu}" if kernel == "student-t" else kernel, kernel, float(nu)


def by_reference(given, kernel, beta, nu, normalisation):
    *points, a, b = given
    weights = ref.weigh(ref.squared_distances(a, b), kernel, beta, nu)
    return ref.moments(ref.normalise(weights, normalisation), *points)


def differences(found, table, connection, pose):
    """Quantities and values of moments that someone found, about the origins they chose."""
    sums = exact.Sums.from_moments(found)
    points = connection.source, connection.target
    true = exact.moments(table, *points, sums.source_origin, sums.target_origin)
    yield "sum of weights", abs(sums.weight / true.weight - 1)
    yield "sum of squared weights", abs(sums.weight_squared / true.weight_squared - 1)
    size = exact.exact(np.linalg.norm(np.ptp(connection.points()[0], axis=0)))
    yield f"{connection.prefix}moments / size", moments_difference(sums, true, size)
    expected = exact.residual_of_pairs(table, *points, exact.rows(pose))
    yield f"{connection.prefix}residual of a pose", abs(exact.exact(residual(found, pose)) / expected - 1)


def residual(found, pose):
    if hasattr(found, "residual"):
        return found.residual(pose)
    return ref.weighted_residual(found, 1.0, pose[:3, :3], pose[:3, 3])


def moments_difference(a, b, size):
    """The largest difference of any moment, over the sum of weights and a power of the size."""
    cross = (x - y for rows in zip(a.cross, b.cross) for x, y in zip(*rows))
    lengths = minus(a.source_sum, b.source_sum) + minus(a.target_sum, b.target_sum)
    squares = [a.source_squares - b.source_squares, a.target_squares - b.target_squares, *cross]
    worst = max(max(map(abs, lengths)) / size, max(map(abs, squares)) / size**2)
    return worst / b.weight


def near_pose(source, target):
    """(4, 4): a rotation of 20 degrees that lays centroid near centroid."""
    pose = np.eye(4)
    pose[:3, :3] = random_rotation(np.random.default_rng(3), degrees=20.0)
    pose[:3, 3] = target.mean(axis=0) + 0.1 - pose[:3, :3] @ source.mean(axis=0)
    return pose


def clear_bandwidth(d2):
    """The middle of the widest gap of squared distances in their second quarter: no pair is
    near the end of a kernel that ends."""
    ordered = np.sort(d2, axis=None)
    ordered = ordered[len(ordered) // 4 : len(ordered) // 2]
    widest = np.diff(ordered).argmax()
    return float(ordered[widest : widest + 2].mean())
