"""TEASER from given matches: every step, with and without scale.

The seeds are the first whose decisions are clear of rounding: which matches are
consistent, which set of them is the largest, which are within the bound at the end, and
at which solve the rotation settles.
"""

import itertools

import numpy as np

from reference.teaser import consistent, teaser
from reference.rotations import random_rotation
from reference.surfaces import as_f32

MATCHES = 40
BOUND = 0.02
THRESHOLD = 0.005
MARGIN = 1e-5
"""Least clearance of distances that decide, in units of the clouds; f32 coordinates round by 6e-8."""


def cases():
    kinds = {"rigid": 1.0, "scale 1.3": 1.3, "scale 0.01": 0.01}
    given, expected = [], []
    for first, (name, scale) in enumerate(kinds.items()):
        problems = (problem(scale, seed) for seed in itertools.count(100 * first))
        source, target, bound = next(filter(is_clear(scale), problems))
        found = teaser(source, target, bound, scale != 1.0, threshold=THRESHOLD)
        given.append(
            {
                "name": name,
                "noise_bound": bound,
                "estimate_scale": scale != 1.0,
                "cost_threshold": THRESHOLD,
                "source": source,
                "target": target,
            }
        )
        expected.append(
            {
                "name": name,
                "scale": found.scale,
                "clique": found.clique,
                "inliers": found.inliers,
                "rounds": [vars(step) for step in found.rounds],
            }
        )
    return {"teaser": (given, expected)}


def problem(scale, seed):
    """Points of a unit cube, moved and off by up to the bound along each axis; of every
    five matches, three are wrong."""
    rng = np.random.default_rng(seed)
    source = rng.uniform(-0.5, 0.5, (MATCHES, 3))
    noise = rng.uniform(-BOUND, BOUND, (MATCHES, 3))
    target = scale * (source @ random_rotation(rng, None).T + noise + rng.normal(size=3))
    wrong = np.arange(MATCHES) % 5 < 3
    target[wrong] = rng.permutation(target[wrong])
    # Among noise of a full bound a few right matches are inconsistent, and cut.
    return as_f32(source), as_f32(target), scale * BOUND


def is_clear(scale):
    def clear(problem):
        source, target, bound = problem
        found = teaser(source, target, bound, scale != 1.0, threshold=THRESHOLD)
        if found is None:
            return False
        margin = scale * MARGIN
        near = (2 * bound - margin, 2 * bound + margin)
        low, high = (consistent(source, target, found.scale, c) for c in near)
        if (low != high).any():
            return False
        last = found.rounds[-1]
        p, q = source[found.clique], target[found.clique]
        rest = np.abs(q - found.scale * p @ last.rotation.T - last.translation)
        costs = np.array([step.cost for step in found.rounds])
        return (
            len(found.rounds) > 3
            and len(found.inliers) < len(found.clique)
            and np.abs(rest - bound).min() > margin
            and np.abs(np.abs(np.diff(costs)) - THRESHOLD).min() > 1e-5
        )

    return clear
