"""Rigid Coherent Point Drift, every step of the first ones, with and without an outlier
part and scale."""

import itertools

import numpy as np

from reference.cpd import steps
from reference.rotations import random_rotation
from reference.surfaces import as_f32, relief

SOURCE, TARGET = 70, 60
STEPS = 30
"""Some more than it takes sigma to fall to the spacing of the points."""


def cases():
    rng = np.random.default_rng(11)
    source = relief(SOURCE, rng)
    still = relief(TARGET, rng)
    turn = random_rotation(rng, degrees=20.0)
    target = as_f32(1.2 * still @ turn.T + [0.2, -0.1, 0.3])
    unit = np.sqrt(((target - target.mean(axis=0)) ** 2).sum(axis=1).mean())
    runs = [
        {"outliers": outliers, "scale": scale, "max_iterations": STEPS}
        for outliers, scale in itertools.product((0.0, 0.1, 0.5), ("fixed", "umeyama"))
    ]
    expected = [
        [as_record(step) for step in steps(source, target, run["outliers"], run["scale"], STEPS, unit)]
        for run in runs
    ]
    return {"cpd": ({"source": source, "target": target, "runs": runs}, expected)}


def as_record(step):
    return {
        "sigma": step.sigma,
        "objective": step.objective,
        "weight": step.weight,
        "pose": vars(step.pose),
    }
