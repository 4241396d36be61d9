"""Iterative closest point, step by step, for every metric and every way to choose pairs.

The seed is the first at which no pair hangs on f32 rounding, in any step of any run.
"""

import itertools

import numpy as np

from reference.icp import icp
from reference.rotations import random_rotation
from reference.surfaces import as_f32, relief

POINTS = 140, 150
DEGREES = 8.0
STEPS = 6
CLEAR = 3e-6
"""Least difference of two distances that decide; the clouds' f32 coordinates are about 1,
off by 6e-8."""

RUNS = {
    "point": {},
    "point within a bound": {"max_distance": 0.15},
    "point trimmed": {"keep": 0.7},
    "point reciprocal": {"reciprocal": True},
    "point robust": {"weights": "geman-mcclure", "bandwidth": 0.1},
    "point all at once": {
        "max_distance": 0.2,
        "keep": 0.9,
        "reciprocal": True,
        "weights": "tukey",
        "bandwidth": 0.3,
    },
    "plane": {"metric": "plane"},
    "plane robust": {"metric": "plane", "keep": 0.9, "weights": "cauchy", "bandwidth": 0.1},
    "generalized": {"metric": "generalized"},
    "generalized robust": {
        "metric": "generalized",
        "max_distance": 0.2,
        "surface_neighbors": 12,
        "weights": "gaussian",
        "bandwidth": 0.2,
    },
}
"""Settings by the crate's names."""


def cases():
    runs = {name: {**settings, "max_iterations": STEPS} for name, settings in RUNS.items()}
    for seed in itertools.count():
        source, target = clouds(seed)
        found = {name: icp(source, target, **settings) for name, settings in runs.items()}
        if min(step.clear for steps in found.values() for step in steps) > CLEAR:
            break
    expected = {
        name: [
            {
                "rotation": step.rotation,
                "translation": step.translation,
                "objective": step.objective,
                "weight": step.weight,
            }
            for step in steps
        ]
        for name, steps in found.items()
    }
    return {"icp": ({"source": source, "target": target, "runs": runs}, expected)}


def clouds(seed):
    """Two independent samples of one relief, the second moved a little."""
    rng = np.random.default_rng(seed)
    source, target = (relief(count, rng) for count in POINTS)
    turn = random_rotation(rng, DEGREES)
    return source, as_f32(target @ turn.T + [0.05, -0.03, 0.04])
