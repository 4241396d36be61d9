"""Normal, curvature and FPFH of a few points, every bin decided exactly."""

from dataclasses import dataclass

import numpy as np

from .numbers import as_float, cross, dot, mean, minus, mp, norm, times

BINS = 11
ROUNDING = 1e-6
"""Relative to a decision's own scale: within it, some ten roundings, f32 may decide otherwise."""


def plane(points):
    """Unit normal (either side), curvature and the three variances of exact points,
    ascending: the eigenproblem of their covariance about the mean."""
    centre = mean(points)
    centred = [minus(p, centre) for p in points]
    covariance = mp.matrix(3, 3)
    for a in range(3):
        for b in range(3):
            covariance[a, b] = mp.fsum(p[a] * p[b] for p in centred) / len(points)
    values, vectors = mp.eigsy(covariance)
    order = sorted(range(3), key=lambda i: values[i])
    variances = [values[i] for i in order]
    normal = [vectors[row, order[0]] for row in range(3)]
    total = mp.fsum(variances)
    return normal, (variances[0] / total if total else mp.mpf(0)), variances


@dataclass(frozen=True)
class ExactFeatures:
    """FPFH of a cloud."""

    histograms: np.ndarray
    """(N, 33) f64, rounded from exact numbers."""
    clear: np.ndarray
    """(N,) whether no decision behind the row lies within f32 rounding of a tie."""
    doubtful_pairs: int
    """Pairs of a point and a neighbour of which some decision does."""


def fpfh(points, normals, k, scale="pcl"):
    """FPFH of exact points and normals (rows; of any length), over `k` neighbours, the point
    itself counted. Rusu, Blodow and Beetz, ICRA 2009; see `reference.fpfh` for the two scales."""
    normals = [times(1 / norm(n), n) for n in normals]
    nearest, decided = neighbourhoods(points, k)
    single, doubtful = [], 0
    for i, neighbours in enumerate(nearest):
        histogram = [mp.mpf(0)] * (3 * BINS)
        for j, _ in neighbours[1:]:
            bins, clear = bins_of(points[i], normals[i], points[j], normals[j])
            decided[i] &= clear
            doubtful += not clear
            for block, place in enumerate(bins):
                histogram[block * BINS + place] += mp.mpf(100) / (k - 1)
        single.append(histogram)
    described = []
    for i, neighbours in enumerate(nearest):
        blocks = mp.matrix(3, BINS)
        for j, d2 in neighbours[1:]:
            for block in range(3):
                for place in range(BINS):
                    blocks[block, place] += single[j][block * BINS + place] / d2
        row = []
        for block in range(3):
            values = [blocks[block, place] for place in range(BINS)]
            row += times(100 / mp.fsum(values), values)
        described.append([a + b for a, b in zip(row, single[i])] if scale == "open3d" else row)
    clear = [decided[i] and all(decided[j] for j, _ in row) for i, row in enumerate(nearest)]
    return ExactFeatures(as_float(described), np.array(clear), doubtful)


def neighbourhoods(points, k):
    """Index and squared distance of each point's k nearest, itself first, and whether the
    k-th is clearly nearer than the next. Points must differ."""
    found, decided = [], []
    for p in points:
        d2 = [dot(x, x) for x in (minus(q, p) for q in points)]
        order = sorted(range(len(points)), key=lambda j: d2[j])
        found.append([(j, d2[j]) for j in order[:k]])
        decided.append(len(order) <= k or bool(d2[order[k]] - d2[order[k - 1]] > ROUNDING * d2[order[k]]))
    return found, decided


def bins_of(p, n, q, m):
    """The three bins of a pair, and whether none of its decisions is near a tie."""
    line = minus(q, p)
    length = norm(line)
    cosines = dot(n, line) / length, dot(m, line) / length
    lead = abs(cosines[0]) - abs(cosines[1])
    # Equal normals tie exactly: the query point is then first, in any arithmetic.
    clear = n == m or abs(lead) > ROUNDING
    u, other, phi = n, m, cosines[0]
    if lead < 0:
        u, other, phi, line = m, n, -cosines[1], times(-1, line)
    v = cross(line, u)
    area = norm(v)
    # The direction of v, and with it theta and alpha, has the rounding of its length.
    slack = ROUNDING * max(length / area, 1)
    v = times(1 / area, v)
    w = cross(u, v)
    theta = mp.atan2(dot(w, other), dot(u, other))
    alpha = dot(v, other)
    positions = [(theta + mp.pi) / (2 * mp.pi), (alpha + 1) / 2, (phi + 1) / 2]
    positions = [BINS * position for position in positions]
    clear = clear and all(abs(x - mp.nint(x)) > BINS * slack for x in positions)
    return [min(int(mp.floor(x)), BINS - 1) for x in positions], bool(clear)
