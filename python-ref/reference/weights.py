"""Weights of all N x M connections from the distance of their descriptors.

A kernel turns the squared distance d² of two descriptors into a weight in [0, 1];
a normalisation then balances rows (source points) and columns (target points).
`beta` has the unit of d². The Gaussian without normalisation is the paper's choice
(section III-B).
"""

import numpy as np
from scipy.spatial.distance import cdist

from .paper import BETA

KERNELS = {
    # exp(-d²/beta): the paper, III-B.
    "gaussian": lambda d2, beta, nu: np.exp(-d2 / beta),
    # exp(-d/sqrt(beta)).
    "laplacian": lambda d2, beta, nu: np.exp(-np.sqrt(d2 / beta)),
    # Cauchy's weight function.
    "cauchy": lambda d2, beta, nu: 1.0 / (1.0 + d2 / beta),
    # Geman and McClure 1987.
    "geman-mcclure": lambda d2, beta, nu: 1.0 / (1.0 + d2 / beta) ** 2,
    # Truncated least squares: all or nothing.
    "truncated": lambda d2, beta, nu: np.where(d2 <= beta, 1.0, 0.0),
    # Student's t density in one dimension, scaled to 1 at zero.
    "student-t": lambda d2, beta, nu: (1.0 + d2 / (nu * beta)) ** (-(nu + 1.0) / 2.0),
    # Tukey's biweight.
    "tukey": lambda d2, beta, nu: np.maximum(0.0, 1.0 - d2 / beta) ** 2,
    # Every connection alike.
    "uniform": lambda d2, beta, nu: np.ones_like(d2),
}
"""Weight of a squared distance `d2`, by name. Only Student's t reads `nu`."""

NORMALISATIONS = ("none", "source", "target", "both", "sinkhorn:n")
"""Names for `normalise`; n is a number of rounds, as in sinkhorn:10."""


def squared_distances(source_descriptors, target_descriptors):
    """Squared Euclidean distances (N, M) by plain differences."""
    return cdist(source_descriptors, target_descriptors, "sqeuclidean")


def weigh(d2, kernel="gaussian", beta=BETA, nu=5.0):
    """Weights of the same shape as the squared distances `d2`."""
    return KERNELS[kernel](np.asarray(d2, dtype=np.float64), beta, nu)


def normalise(weights, normalisation="none"):
    """The (N, M) weights, balanced.

    none           w
    source         w / row sum: every source point counts 1
    target         w / column sum: every target point counts 1
    both           w² / (row sum * column sum): the product of the two above
    sinkhorn:n     n times: rows to sum 1/N, then columns to sum 1/M (Sinkhorn 1967)

    A row or column without any weight stays without.
    """
    name, _, rounds = normalisation.partition(":")
    if name == "none":
        return weights
    if name == "source":
        return _share(weights, weights.sum(axis=1, keepdims=True))
    if name == "target":
        return _share(weights, weights.sum(axis=0, keepdims=True))
    if name == "both":
        by_row = _share(weights, weights.sum(axis=1, keepdims=True))
        by_column = _share(weights, weights.sum(axis=0, keepdims=True))
        return by_row * by_column
    if name == "sinkhorn":
        return _sinkhorn(weights, int(rounds))
    raise ValueError(f"normalisation must be one of {NORMALISATIONS}, not {normalisation!r}")


def _sinkhorn(weights, rounds):
    rows, columns = weights.shape
    for _ in range(rounds):
        weights = _share(weights, rows * weights.sum(axis=1, keepdims=True))
        weights = _share(weights, columns * weights.sum(axis=0, keepdims=True))
    return weights


def _share(weights, sums):
    """weights / sums, and 0 where the sum is 0."""
    return np.divide(weights, sums, out=np.zeros_like(weights), where=sums > 0)
