"""CF-spectral: the strongest connections, weighted to the second order, solved once.

Two connections are compatible when they keep their length (Leordeanu and Hebert, ICCV 2005), and
their normals the angle between them; to the second order, as far as others are compatible with
both (SC2-PCR, Chen et al., CVPR 2022). The weights are the squared leading eigenvector.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Rule:
    """When two connections are compatible; lengths in units of the clouds' resolution."""

    length_tolerance: float = 1.5
    """Largest difference of the two lengths."""
    min_length: float = 2.0
    """Smallest length: near points keep their distance under nearly every pose."""
    normal_tolerance: float = 0.5
    """Largest difference of the cosines between the two normals."""


def strongest(weights, count):
    """Rows and columns of the `count` largest of (N, M) weights, the largest first; equal ones by
    row, then by column."""
    order = np.argsort(-weights, axis=None, kind="stable")[:count]
    source, target = np.unravel_index(order, weights.shape)
    positive = weights[source, target] > 0.0
    return source[positive], target[positive]


def measures(points, normals):
    """Distances and cosines between the normals of all pairs, both (K, K)."""
    return np.linalg.norm(points[:, None] - points, axis=2), normals @ normals.T


def first_order(source, target, unit, rule=Rule()):
    """C: which connections are compatible, (K, K) of 0 and 1. `source` and `target` are the points
    and normals, (K, 3) each, at the ends of the connections."""
    (a, cosine), (b, other) = measures(*source), measures(*target)
    kept = np.abs(a - b) <= rule.length_tolerance * unit
    apart = np.minimum(a, b) >= rule.min_length * unit
    turned = np.abs(cosine - other) <= rule.normal_tolerance
    compatible = kept & apart & turned
    np.fill_diagonal(compatible, False)
    return compatible.astype(float)


def second_order(compatible):
    """C o C^2: how many connections are compatible with both of two compatible ones."""
    return compatible * (compatible @ compatible)


def spectral_weights(measure):
    """The squared leading eigenvector over its largest entry, and the two largest eigenvalues."""
    values, vectors = np.linalg.eigh(measure)
    vector = np.abs(vectors[:, -1])
    return (vector / vector.max()) ** 2, values[[-1, -2]]
