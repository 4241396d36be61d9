"""CF-spectral on the clouds and descriptors of the case `weights`: connections, weights, pose.

The number of connections and the unit are the first whose decisions are clear of rounding: which
connections are the strongest, and which of them are compatible.
"""

import itertools

import numpy as np

import reference as ref
from reference.golden import stages
from reference.scans import relief_pair
from reference.spectral import (
    Rule,
    first_order,
    measures,
    second_order,
    spectral_weights,
    strongest,
)
from reference.surfaces import as_f32

GAP = 1e-3
"""Least relative gap between the weights of the last connection and the next: those of the crate
are off by up to 1e-3 / beta of the squared norm of a descriptor."""
MARGIN = 1e-5
"""Least clearance of lengths, in units, and of cosines that decide."""
RULE = Rule()


def cases():
    pair = next(filter(stages.is_clear, (relief_pair(stages.POINTS, seed) for seed in itertools.count())))
    rows = stages.descriptors_of(pair)
    d2 = ref.squared_distances(*rows)
    weights = ref.normalise(ref.weigh(d2, "gaussian", stages.WIDE_BETA), "both")
    count = next(filter(lambda count: has_gap(weights, count), itertools.count(300)))
    source, target = strongest(weights, count)
    normals = [
        as_f32(stages.stages_of_cloud(points, viewpoint)["normals"])
        for points, viewpoint in (
            (pair.source, pair.source_viewpoint),
            (pair.target, pair.target_viewpoint),
        )
    ]
    ends = [(pair.source[source], normals[0][source]), (pair.target[target], normals[1][target])]
    resolution = float(np.sqrt(np.median(ref.nearest(pair.source, 2)[1][:, 1])))
    units = (round(resolution, 3) + step / 1024 for step in itertools.count())
    unit = next(filter(lambda unit: is_clear(ends, unit), units))
    compatible = first_order(*ends, unit, RULE)
    second, eigenvalues = spectral_weights(second_order(compatible))
    full = np.zeros_like(weights)
    full[source, target] = second
    sums = ref.moments(full, pair.source, pair.target)
    given = {
        "beta": stages.WIDE_BETA,
        "connections": count,
        "unit": unit,
        "compatibility": vars(RULE),
        "source_normals": normals[0],
        "target_normals": normals[1],
    }
    expected = {
        "pairs": np.stack([source, target], axis=1),
        "first": weights[source, target],
        "compatible": int(compatible.sum()) // 2,
        "second": second,
        "eigenvalues": eigenvalues,
        **stages.sums_and_pose(sums),
    }
    return {"spectral": (given, expected)}


def has_gap(weights, count):
    ordered = -np.sort(-weights, axis=None)[: count + 1]
    return ordered[-1] < (1.0 - GAP) * ordered[-2]


def is_clear(ends, unit):
    (a, cosine), (b, other) = (measures(*end) for end in ends)
    # Connections that share a point have one length of exactly 0.
    kept = np.abs(np.abs(a - b) - RULE.length_tolerance * unit)
    apart = np.abs(np.minimum(a, b) - RULE.min_length * unit)
    turned = np.abs(np.abs(cosine - other) - RULE.normal_tolerance)
    return min(kept.min(), apart.min()) > MARGIN * unit and turned.min() > 1e-6
