"""DARE's EM, step by step: with density weights, without, and with other settings."""

import itertools

import numpy as np

from reference import separation
from reference.dare import dare
from reference.rotations import random_rotation
from reference.surfaces import as_f32, relief

ITERATIONS = 25

RUNS = (
    {"components": 12, "density_neighbors": 8},
    {"components": 12, "density_neighbors": 0, "min_sigma": 0.001},
    {"components": 8, "density_neighbors": 5, "outlier_ratio": 0.1, "initial_sigma": 1.0},
)


def cases():
    rng = np.random.default_rng(11)
    source = dense_on_one_side(relief(140, rng))
    turn = random_rotation(rng, degrees=20.0)
    target = as_f32(relief(80, rng) @ turn.T + [0.3, -0.2, 0.5])
    for run, cloud in itertools.product(RUNS, (source, target)):
        # No neighbourhood is near a tie that f32 would decide otherwise.
        if run["density_neighbors"]:
            assert separation(cloud, run["density_neighbors"]).min() > 5e-6
    given = {"source": source, "target": target, "iterations": ITERATIONS, "runs": list(RUNS)}
    expected = {"runs": [steps(dare(source, target, iterations=ITERATIONS, **run)) for run in RUNS]}
    return {"dare": (given, expected)}


def dense_on_one_side(points):
    """Only every third point where x > 0."""
    return points[(points[:, 0] < 0) | (np.arange(len(points)) % 3 == 0)]


def steps(found):
    return [
        {
            "rotation": step.pose.rotation,
            "translation": step.pose.translation,
            "log_likelihood": step.log_likelihood,
            "weight": step.weight,
            "sigma": step.sigma,
        }
        for step in found
    ]
