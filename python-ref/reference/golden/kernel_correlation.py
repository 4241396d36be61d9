"""Kernel correlation, every step of four levels.

The seed is the first at which no level's end is near a tie: the share by which the
correlation grows is clear of the tolerance.
"""

import itertools

import numpy as np

from reference.kernel_correlation import schedule, steps
from reference.pose import Pose
from reference.rotations import random_rotation
from reference.surfaces import as_f32, relief

SOURCE, TARGET = 70, 60
SIGMA, LAST, FACTOR = 0.4, 0.1, 0.6
TOLERANCE = 1e-4
MAX_ITERATIONS = 30
MARGIN = 0.05
"""Least distance of a growth to the tolerance, in tolerances."""


def cases():
    return {"kernel_correlation": next(filter(None, map(case, itertools.count())))}


def case(seed):
    """Input and expected steps, or None where a level's end is near a tie."""
    rng = np.random.default_rng(seed)
    source = relief(SOURCE, rng)
    turn = random_rotation(rng, degrees=60.0)
    target = as_f32(relief(TARGET, rng) @ turn.T + [0.2, -0.1, 0.3])
    off = random_rotation(rng, degrees=15.0)
    initial = Pose(1.0, off @ turn, np.array([0.15, -0.1, 0.35]))
    found = steps(source, target, initial, schedule(SIGMA, LAST, FACTOR), TOLERANCE, MAX_ITERATIONS)
    if not all(abs(growth / TOLERANCE - 1) > MARGIN for growth in growths(found)):
        return None
    given = {
        "source": source,
        "target": target,
        "initial": vars(initial),
        "sigma": SIGMA,
        "last_sigma": LAST,
        "factor": FACTOR,
        "tolerance": TOLERANCE,
        "max_iterations": MAX_ITERATIONS,
    }
    return given, [
        {"sigma": step.sigma, "correlation": step.correlation, "pose": vars(step.pose)}
        for step in found
    ]


def growths(found):
    """By which share the correlation grew, from step to step of a level."""
    for one, next_one in itertools.pairwise(found):
        if one.sigma == next_one.sigma:
            yield 1 - one.correlation / next_one.correlation
