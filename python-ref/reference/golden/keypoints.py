"""Keypoints of small reliefs: SIFT on the curvature, and ISS, each for a few settings.

Seeds are the first whose answers are clear of rounding: noise on coordinates and values,
of ten times the rounding of f32, changes none of them.
"""

import itertools

import numpy as np

from reference.keypoints import iss, sift_octaves
from reference.normals import normals
from reference.surfaces import VIEWPOINT, as_f32, relief

POINTS = 400
NEIGHBORS = 20
NOISE = 10 * 2.0**-24
"""Relative to the size of the relief, and to the largest value."""
DRAWS = 6

SIFT = (
    {"min_scale": 0.05, "octaves": 3, "scales": 4, "min_contrast": 0.0},
    {"min_scale": 0.03, "octaves": 2, "scales": 2, "min_contrast": 0.0},
    {"min_scale": 0.05, "octaves": 3, "scales": 4, "min_contrast": 0.002},
)
"""Scales in the unit of the relief; neighbours are about 0.04 apart."""
ISS = (
    {"salient_radius": 0.3, "non_max_radius": 0.2, "gamma21": 0.975, "gamma32": 0.975},
    {"salient_radius": 0.2, "non_max_radius": 0.1, "gamma21": 0.8, "gamma32": 0.5},
)


def cases():
    chosen = []
    for seed in itertools.count():
        points, values = surface(seed)
        if is_clear(points, values, np.random.default_rng(seed)):
            chosen.append((points, values))
        if len(chosen) == 2:
            break
    given = {
        "sift": SIFT,
        "iss": ISS,
        "surfaces": [{"points": points, "values": values} for points, values in chosen],
    }
    return {"keypoints": (given, [answers(points, values) for points, values in chosen])}


def surface(seed):
    """A relief seen from above, and its curvature."""
    points = relief(POINTS, np.random.default_rng(seed))
    return points, as_f32(normals(points, NEIGHBORS, VIEWPOINT)[1])


def answers(points, values):
    """For SIFT the points that are nearest to each extremum, all of them where the mean of
    two points is as near to one as to the other; for ISS indices."""
    found = []
    for settings in SIFT:
        places = [thin[keys] for thin, _, keys in sift_octaves(points, values, **settings)]
        found.append(sorted({tuple(nearest(points, place)) for place in np.vstack(places)}))
    return {"sift": found, "iss": [iss(points, **settings) for settings in ISS]}


def nearest(points, place):
    distances = np.linalg.norm(points - place, axis=1)
    return np.flatnonzero(distances <= distances.min() + 1e-5).tolist()


def is_clear(points, values, rng):
    wanted = answers(points, values)
    for _ in range(DRAWS):
        moved = points + NOISE * np.ptp(points) * rng.normal(size=points.shape)
        changed = values + NOISE * values.max() * rng.normal(size=values.shape)
        found = answers(moved, changed)
        if found["sift"] != wanted["sift"]:
            return False
        if not all(map(np.array_equal, found["iss"], wanted["iss"])):
            return False
    return True
