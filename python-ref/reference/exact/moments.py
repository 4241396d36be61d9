"""Kernels, normalisations, moments and residuals as their definitions say them."""

from dataclasses import dataclass

from .numbers import applied, dot, exact, minus, mp

KERNELS = {
    "gaussian": lambda d2, beta, nu: mp.exp(-d2 / beta),
    "laplacian": lambda d2, beta, nu: mp.exp(-mp.sqrt(d2) / mp.sqrt(beta)),
    "cauchy": lambda d2, beta, nu: beta / (beta + d2),
    "geman-mcclure": lambda d2, beta, nu: beta**2 / (beta + d2) ** 2,
    "truncated": lambda d2, beta, nu: mp.mpf(d2 <= beta),
    "student-t": lambda d2, beta, nu: (nu * beta / (nu * beta + d2)) ** ((nu + 1) / 2),
    "tukey": lambda d2, beta, nu: (1 - d2 / beta) ** 2 if d2 < beta else mp.mpf(0),
    "uniform": lambda d2, beta, nu: mp.mpf(1),
}
"""Weight of an exact squared distance by the names of the catalogue."""


@dataclass(frozen=True)
class Sums:
    """As `reference.Moments`, of exact numbers: vectors are lists, `cross` a list of rows."""

    weight: object
    weight_squared: object
    source_sum: list
    target_sum: list
    cross: list
    source_squares: object
    target_squares: object
    source_origin: list
    target_origin: list

    @classmethod
    def from_moments(cls, found):
        """The moments that someone else found, digit for digit."""
        vector = lambda name: [exact(x) for x in getattr(found, name)]
        return cls(
            weight=exact(found.weight),
            weight_squared=exact(found.weight_squared),
            source_sum=vector("source_sum"),
            target_sum=vector("target_sum"),
            cross=[[exact(x) for x in row] for row in found.cross],
            source_squares=exact(found.source_squares),
            target_squares=exact(found.target_squares),
            source_origin=vector("source_origin"),
            target_origin=vector("target_origin"),
        )


def weights(d2, kernel="gaussian", beta=100.0, nu=5.0, normalisation="none"):
    """Rows of weights from rows of exact squared distances. A row or a column without any
    weight stays without."""
    beta, nu = exact(beta), exact(nu)
    table = [[KERNELS[kernel](value, beta, nu) for value in row] for row in d2]
    name, _, rounds = normalisation.partition(":")
    if name == "none":
        return table
    if name == "source":
        return per_row(table, 1)
    if name == "target":
        return transposed(per_row(transposed(table), 1))
    if name == "both":
        of_source = per_row(table, 1)
        of_target = transposed(per_row(transposed(table), 1))
        return [[a * b for a, b in zip(*lines)] for lines in zip(of_source, of_target)]
    if name == "sinkhorn":
        for _ in range(int(rounds)):
            table = per_row(table, mp.mpf(1) / len(table))
            columns = transposed(table)
            table = transposed(per_row(columns, mp.mpf(1) / len(columns)))
        return table
    raise ValueError(normalisation)


def per_row(table, total):
    """Every row scaled to sum to `total`."""
    sums = [mp.fsum(row) for row in table]
    return [[total * w / s for w in row] if s else row for row, s in zip(table, sums)]


def transposed(table):
    return [list(column) for column in zip(*table)]


def squared_distances(source, target):
    return [[dot(difference, difference) for difference in (minus(a, b) for b in target)] for a in source]


def moments(table, source, target, source_origin, target_origin):
    """`Sums` of rows of weights and exact points about exact origins."""
    p = [minus(point, source_origin) for point in source]
    q = [minus(point, target_origin) for point in target]
    by_source = [mp.fsum(row) for row in table]
    by_target = [mp.fsum(column) for column in transposed(table)]
    partners = [[dot(row, axis) for axis in transposed(q)] for row in table]
    return Sums(
        weight=mp.fsum(by_source),
        weight_squared=mp.fsum(w * w for row in table for w in row),
        source_sum=[dot(by_source, axis) for axis in transposed(p)],
        target_sum=[dot(by_target, axis) for axis in transposed(q)],
        cross=[[dot(a, b) for b in transposed(partners)] for a in transposed(p)],
        source_squares=dot(by_source, [dot(x, x) for x in p]),
        target_squares=dot(by_target, [dot(x, x) for x in q]),
        source_origin=source_origin,
        target_origin=target_origin,
    )


def residual(sums, matrix):
    """sum w |A p + t - q|² of any 4 x 4 matrix (A, t), from the moments alone.

    With e = A o_p + t - o_q the sum is that of |A p' - q' + e|², written out.
    """
    turn, shift = [row[:3] for row in matrix[:3]], [row[3] for row in matrix[:3]]
    moved = applied(turn, sums.source_origin)
    e = [a + t - q for a, t, q in zip(moved, shift, sums.target_origin)]
    # A is a rotation times a scale but for rounding: |A p'|² = s² |p'|² with the mean s².
    scale2 = mp.fsum(x * x for row in turn for x in row) / 3
    mixed = mp.fsum(turn[a][b] * sums.cross[b][a] for a in range(3) for b in range(3))
    pulled = dot(e, minus(applied(turn, sums.source_sum), sums.target_sum))
    squares = scale2 * sums.source_squares + sums.target_squares
    return squares - 2 * mixed + 2 * pulled + sums.weight * dot(e, e)


def residual_of_pairs(table, source, target, matrix):
    """The same as the double sum over all pairs."""
    moved = [[dot(row[:3], p) + row[3] for row in matrix[:3]] for p in source]
    d2 = squared_distances(moved, target)
    return mp.fsum(dot(row, line) for row, line in zip(table, d2))
