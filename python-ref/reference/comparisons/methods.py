"""Every method of the crate beside its plain reference, step by step where it iterates.

Pairs and settings are those of the golden cases where these have clouds (`reference.golden`),
whose seeds are clear of ties; TEASER and CFK start from descriptors and have pairs of their
own, checked here to be as clear.
"""

import importlib
import itertools

import numpy as np

import reference as ref
from peers.methods.cfk import SIFT, resolution
from peers.methods.icp import METHODS
from peers.programs import crate
from reference.golden import teaser as golden_teaser
from reference.golden.keypoints import NOISE, nearest
from reference.keypoints import sift_octaves
from reference.pose_error import centroid_shift, rotation_degrees
from reference.rotations import random_rotation
from reference.surfaces import VIEWPOINT, as_f32, relief
from reference.teaser import teaser

NEIGHBORS = 30
CFK_NEIGHBORS = 60
NOISE_BOUND = 0.02
THRESHOLD = golden_teaser.THRESHOLD

STEP = "f32 coordinates: 6e-8 a step, handed on"
CLEAR = "no decision of these pairs is within rounding of a tie"
BOUNDS = {
    "every step: rotation and scale": (5e-6, STEP + "; DARE's first steps enlarge it"),
    "every step: translation / size": (1e-6, STEP),
    "every step: objective, relative": (1e-6, STEP),
    "every step: weight, relative": (1e-6, STEP),
    "every step: bandwidth, relative": (2e-6, STEP),
    "last pose: rotation and scale": (1e-6, STEP),
    "last pose: translation / size": (1e-6, STEP),
    "steps more or fewer": (0.0, CLEAR),
    "keypoints in one only": (0.0, CLEAR),
    "cfk: rotation, degrees": (1e-3, "as `register`, no pair in another bin"),
    "cfk: translation / size": (1e-5, "as `register`, no pair in another bin"),
}


def sections(scope):
    if scope.cfreg:
        yield "methods beside their references", measured(scope.cfreg)


def measured(cfreg):
    for module, runs in (
        ("icp", icp_runs),
        ("kernel_correlation", kernel_correlation_runs),
        ("cpd", cpd_runs),
        ("dare", dare_runs),
    ):
        (given, expected), = importlib.import_module(f"reference.golden.{module}").cases().values()
        clouds = [np.asarray(given[side]) for side in ("source", "target")]
        for method, label, initial, settings, steps in runs(given, expected):
            if initial is not None:
                settings = {**settings, "initial": initial}
            found = crate.register(*clouds, method, trace=True, **settings)
            yield from compared(f"cfreg - {method}", label, found, steps, clouds[0])
    yield from by_teaser()
    yield from by_keypoints(cfreg)


# --- the golden cases as settings of the package -----------------------------------------
# Each yields method, label, initial pose, settings and the reference's steps.


def icp_runs(given, expected):
    method_of = {metric: method for method, metric in METHODS.items()}
    for name, run in given["runs"].items():
        settings = {key: value for key, value in run.items() if key != "metric"}
        yield method_of[run.get("metric", "point")], name, None, settings, expected[name]


def kernel_correlation_runs(given, expected):
    names = ("sigma", "last_sigma", "factor", "tolerance", "max_iterations")
    initial = matrix(given["initial"])
    steps = [{**step, "objective": step["correlation"], "bandwidth": step["sigma"]} for step in expected]
    yield "kc", "four levels", initial, {name: given[name] for name in names}, steps


def cpd_runs(given, expected):
    for run, steps in zip(given["runs"], expected):
        label = f"outliers {run['outliers']}, {run['scale']}"
        steps = [{**step, "bandwidth": step["sigma"]} for step in steps]
        yield "cpd", label, None, {**run, "tolerance": 0.0}, steps


def dare_runs(given, expected):
    for run, steps in zip(given["runs"], expected["runs"]):
        settings = {**run, "max_iterations": given["iterations"], "tolerance": 0.0}
        renamed = [
            {**step, "objective": step["log_likelihood"], "bandwidth": step["sigma"]} for step in steps
        ]
        yield "dare", f"{run['components']} components", None, settings, renamed


def matrix(step):
    """The (4, 4) pose of a step of the reference."""
    step = step.get("pose", step)
    pose = np.eye(4)
    pose[:3, :3] = step.get("scale", 1.0) * np.asarray(step["rotation"])
    pose[:3, 3] = step["translation"]
    return pose


def compared(who, label, found, steps, source):
    size = np.linalg.norm(np.ptp(source, axis=0))
    label = f"{who}, {label}"
    yield "steps more or fewer", label, abs(len(found.trace) - len(steps))
    for mine, step in zip(found.trace, steps):
        turned, shifted = pose_difference(np.asarray(mine["transform"]), matrix(step), size)
        yield "every step: rotation and scale", label, turned
        yield "every step: translation / size", label, shifted
        for name in ("objective", "weight", "bandwidth"):
            if step.get(name) is not None:
                yield f"every step: {name}, relative", label, abs(mine[name] / step[name] - 1)
    turned, shifted = pose_difference(found.transform, matrix(steps[-1]), size)
    yield "last pose: rotation and scale", label, turned
    yield "last pose: translation / size", label, shifted


def pose_difference(a, b, size):
    """The largest difference of the upper left entries, and of the shift over the size."""
    return np.abs(a - b)[:3, :3].max(), np.linalg.norm((a - b)[:3, 3]) / size


# --- TEASER ----------------------------------------------------------------------------


def by_teaser():
    """From descriptors to pose: normals, FPFH and mutual matches of the reference, then its
    TEASER; with and without scale."""
    for scale in (1.0, 1.3):
        clouds, matched, bound = clear_matches(scale)
        expected = teaser(*matched, bound, scale != 1.0, threshold=THRESHOLD)
        steps = [
            {**vars(step), "scale": expected.scale, "objective": step.cost} for step in expected.rounds
        ]
        found = crate.register(
            *clouds,
            "teaser",
            neighbors=NEIGHBORS,
            noise_bound=bound,
            estimate_scale=scale != 1.0,
            cost_threshold=THRESHOLD,
            trace=True,
        )
        label = f"scale {scale}, {len(matched[0])} matches"
        yield from compared("cfreg - teaser", label, found, steps, clouds[0])


def clear_matches(scale):
    """A relief, its moved copy that is off by up to the bound, their mutual matches and the
    bound; the seed is the first whose decisions in TEASER are clear."""
    for seed in itertools.count():
        rng = np.random.default_rng(seed)
        source = as_f32(relief(200, rng) - VIEWPOINT)
        noise = rng.uniform(-NOISE_BOUND, NOISE_BOUND, source.shape)
        target = as_f32(scale * (source + noise) @ random_rotation(rng, 70.0).T)
        clouds = source, target
        pairs = mutual(ref.squared_distances(*(features(cloud, NEIGHBORS) for cloud in clouds)))
        matched = [cloud[side] for cloud, side in zip(clouds, pairs.T)]
        if golden_teaser.is_clear(scale)((*matched, scale * NOISE_BOUND)):
            return clouds, matched, scale * NOISE_BOUND


def features(cloud, k):
    """FPFH in f32 from f32 normals that look at the origin."""
    return as_f32(ref.fpfh(cloud, as_f32(ref.normals(cloud, k)[0]), k))


def mutual(d2):
    """(n, 2): pairs that are each other's nearest."""
    there, back = d2.argmin(axis=1), d2.argmin(axis=0)
    rows = np.flatnonzero(back[there] == np.arange(len(there)))
    return np.column_stack([rows, there[rows]])


# --- CFK -------------------------------------------------------------------------------


def by_keypoints(cfreg):
    """The crate's keypoints beside the reference's, then the pose from the crate's: where
    two points are as near to an extremum, either is right."""
    source, target = clouds = two_views()
    keys = []
    for cloud in clouds:
        values = curvature(cloud)
        found = cfreg.keypoints(cloud, values=values, **SIFT).astype(int)
        yield "keypoints in one only", "cfreg - keypoints", in_one_only(found, keypoints(cloud, values))
        keys.append(found)
    described = [features(cloud, CFK_NEIGHBORS)[rows] for cloud, rows in zip(clouds, keys)]
    weights = ref.weigh(ref.squared_distances(*described), "gaussian", ref.BETA)
    expected = ref.solve(ref.moments(weights, source[keys[0]], target[keys[1]])).matrix()
    found = crate.register(source, target, "cfk", neighbors=CFK_NEIGHBORS, detector={"sift": SIFT})
    label = f"cfreg - cfk, {len(keys[0])} and {len(keys[1])} keypoints"
    yield "cfk: rotation, degrees", label, rotation_degrees(found.transform, expected)
    yield "cfk: translation / size", label, centroid_shift(found.transform, expected, source)


def two_views():
    """Two samples of the relief about its viewpoint; the seed is the first whose keypoints
    stay when coordinates and curvature get noise of ten f32 roundings."""
    for seed in itertools.count():
        rng = np.random.default_rng(seed)
        turn = random_rotation(rng, degrees=40.0)
        samples = [relief(401, rng) - VIEWPOINT for _ in range(2)]
        clouds = as_f32(samples[0]), as_f32(samples[1] @ turn.T)
        if all(is_clear(cloud, rng) for cloud in clouds):
            return clouds


def curvature(cloud):
    return as_f32(ref.normals(cloud, CFK_NEIGHBORS)[1])


def keypoints(cloud, values):
    """For each extremum the points nearest to it: several where they tie."""
    scale = SIFT["min_scale"] * resolution(cloud)
    octaves = sift_octaves(cloud, values, scale, *list(SIFT.values())[1:])
    places = np.vstack([thin[keys] for thin, _, keys in octaves])
    return {tuple(nearest(cloud, place)) for place in places}


def in_one_only(found, expected):
    """How many extrema have none of their points among the found, and how many of these
    belong to no extremum."""
    found = set(found.tolist())
    missed = sum(not found.intersection(points) for points in expected)
    return missed + len(found.difference(*expected))


def is_clear(cloud, rng, draws=3):
    values = curvature(cloud)
    expected = keypoints(cloud, values)
    size = np.ptp(cloud, axis=0).max()
    noisy = lambda what, size: what + NOISE * size * rng.normal(size=what.shape)
    return all(
        keypoints(noisy(cloud, size), noisy(values, values.max())) == expected for _ in range(draws)
    )
