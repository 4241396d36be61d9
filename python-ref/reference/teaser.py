"""TEASER on given matches (Yang, Shi and Carlone, T-RO 2021), by enumeration where that is plain.

The four steps of the paper: scale by adaptive voting over ratios of distances, the largest
clique of consistent matches, rotation by graduated non-convexity on truncated least
squares (Yang, Antonante, Tzoumas and Carlone, RA-L 2020), translation by adaptive voting
along each axis.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Round:
    """One solve for the rotation."""

    rotation: np.ndarray
    cost: float
    """Sum of w r^2 / c^2 with the weights of this solve."""
    weight: float
    translation: np.ndarray
    """Voted for with this rotation."""


@dataclass(frozen=True)
class Teaser:
    scale: float
    clique: list
    rounds: list
    inliers: np.ndarray
    """Matches of the clique within the bound along every axis."""


def teaser(source, target, bound, estimate_scale=False, factor=1.4, threshold=0.005):
    """`source[k]` may correspond to `target[k]`; a right match is off by `bound` at most.
    None when two sets of consistent matches are the largest."""
    k, l = np.triu_indices(len(source), 1)
    a, b = source[l] - source[k], target[l] - target[k]
    # Either point of a difference may be off.
    c = 2.0 * bound
    scale = 1.0
    if estimate_scale:
        length = np.linalg.norm(a, axis=1)
        scale = adaptive_voting(np.linalg.norm(b, axis=1) / length, c / length)
    clique = largest_clique(consistent(source, target, scale, c))
    if clique is None:
        return None
    p, q = source[clique], target[clique]
    k, l = np.triu_indices(len(clique), 1)
    rounds = []
    for rotation, cost, weight in gnc_tls(scale * (p[l] - p[k]), q[l] - q[k], c, factor, threshold):
        rest = q - scale * p @ rotation.T
        translation = np.array([adaptive_voting(axis, np.full(len(p), bound)) for axis in rest.T])
        rounds.append(Round(rotation, cost, weight, translation))
    rest = q - scale * p @ rounds[-1].rotation.T - rounds[-1].translation
    inliers = np.array(clique)[(np.abs(rest) <= bound).all(axis=1)]
    return Teaser(scale, clique, rounds, inliers)


def consistent(source, target, scale, bound):
    """Which matches keep their distance: a symmetric matrix of booleans."""
    a = np.linalg.norm(source[:, None] - source, axis=2)
    b = np.linalg.norm(target[:, None] - target, axis=2)
    return (np.abs(b - scale * a) <= bound) & ~np.eye(len(source), dtype=bool)


def largest_clique(joined):
    """The largest set of vertices that are all joined, ascending; None when two sets are
    that large."""
    neighbours = [set(np.flatnonzero(row)) for row in joined]
    cliques = list(maximal_cliques(neighbours, set(), set(range(len(joined))), set()))
    size = max(map(len, cliques))
    largest = [clique for clique in cliques if len(clique) == size]
    return sorted(largest[0]) if len(largest) == 1 else None


def maximal_cliques(neighbours, chosen, candidates, done):
    """Bron and Kerbosch 1973, with a pivot."""
    if not candidates and not done:
        yield chosen
        return
    pivot = max(candidates | done, key=lambda v: len(candidates & neighbours[v]))
    for v in candidates - neighbours[pivot]:
        yield from maximal_cliques(
            neighbours, chosen | {v}, candidates & neighbours[v], done & neighbours[v]
        )
        candidates = candidates - {v}
        done = done | {v}


def adaptive_voting(x, bounds):
    """The number that minimises sum min((x - x_k)^2 / bound_k^2, 1), by trying the weighted
    mean of every consensus set: those between neighbouring ends x_k +- bound_k."""
    ends = np.sort(np.concatenate([x - bounds, x + bounds]))
    places = np.concatenate([ends, (ends[1:] + ends[:-1]) / 2])
    best = (np.inf, 0.0)
    for place in places:
        within = np.abs(x - place) <= bounds
        if within.any():
            mean = np.average(x[within], weights=bounds[within] ** -2)
            cost = np.minimum(((x - mean) / bounds) ** 2, 1.0).sum()
            best = min(best, (cost, mean))
    return best[1]


def gnc_tls(a, b, bound, factor, threshold):
    """Rotation, cost and weight of every solve for b = R a with truncation at `bound`."""
    weights, previous, mu = np.ones(len(a)), None, None
    while True:
        rotation = wahba(a, b, weights)
        r2 = ((b - a @ rotation.T) ** 2).sum(axis=1) / bound**2
        cost = (weights * r2).sum()
        yield rotation, cost, weights.sum()
        if previous is None:
            if 2 * r2.max() <= 1:
                return
            mu = 1 / (2 * r2.max() - 1)
        elif abs(previous - cost) < threshold:
            return
        else:
            mu *= factor
        previous = cost
        between = np.sqrt(mu * (mu + 1) / np.maximum(r2, 1e-300)) - mu
        weights = np.where(r2 <= mu / (mu + 1), 1.0, np.where(r2 >= (mu + 1) / mu, 0.0, between))


def wahba(a, b, weights):
    """The rotation that minimises sum w |b - R a|^2, by SVD."""
    u, _, vt = np.linalg.svd((weights[:, None] * b).T @ a)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
