"""The pose of least residual by one route for all solvers: Horn's quaternion.

The eigenvalues of his 4 x 4 matrix are, in descending order, s1 + s2 + e s3,
s1 - s2 - e s3, -s1 + s2 - e s3 and -s1 - s2 + e s3, with s1 >= s2 >= s3 the singular values of
the cross covariance and e the sign of its determinant. They therefore also say how well
the rotation is determined.
"""

from dataclasses import dataclass

from .numbers import applied, dot, mp, times


@dataclass(frozen=True)
class Solution:
    scale: object
    rotation: list
    """Rows."""
    translation: list
    singular_values: tuple
    """s1, s2 and e s3 of the centred cross covariance."""

    def matrix(self):
        """Rows of the homogeneous 4 x 4 matrix T_target_source."""
        turn = [times(self.scale, row) for row in self.rotation]
        return [[*row, t] for row, t in zip(turn, self.translation)] + [[mp.mpf(x) for x in (0, 0, 0, 1)]]

    def condition(self, solver):
        """By how much a relative error of the cross covariance turns the rotation, in
        radians, at most. Horn's matrix squares it first, and so the condition."""
        first, second, third = self.singular_values
        if solver == "horn-matrix":
            return first**2 / (second * (second + third))
        return first / (second + third)


def solve(sums, scale="fixed"):
    """From `Sums`; `scale` is fixed, umeyama or symmetric."""
    p_mean = times(1 / sums.weight, sums.source_sum)
    q_mean = times(1 / sums.weight, sums.target_sum)
    s = [
        [sums.cross[a][b] - sums.source_sum[a] * q_mean[b] for b in range(3)] for a in range(3)
    ]
    values, quaternion = greatest_eigenvector(horn(s))
    rotation = rotation_of(quaternion)
    source_spread = sums.source_squares - dot(sums.source_sum, p_mean)
    target_spread = sums.target_squares - dot(sums.target_sum, q_mean)
    factor = {
        "fixed": lambda: mp.mpf(1),
        # tr(R S) is the greatest eigenvalue, the quaternion's q^T N q.
        "umeyama": lambda: values[0] / source_spread,
        "symmetric": lambda: mp.sqrt(target_spread / source_spread),
    }[scale]()
    from_mean = [o + m for o, m in zip(sums.source_origin, p_mean)]
    to_mean = [o + m for o, m in zip(sums.target_origin, q_mean)]
    moved = times(factor, applied(rotation, from_mean))
    translation = [b - a for a, b in zip(moved, to_mean)]
    singular = tuple((values[0] + other) / 2 for other in values[1:])
    return Solution(factor, rotation, translation, singular)


def horn(s):
    """N with q^T N q = tr(R(q) S), q scalar first, from S = sum w x y^T, element for
    element from R(q) = (q0² - v.v) I + 2 v v^T + 2 q0 K(v)."""
    trace = s[0][0] + s[1][1] + s[2][2]
    turn = [s[1][2] - s[2][1], s[2][0] - s[0][2], s[0][1] - s[1][0]]
    n = mp.matrix(4, 4)
    n[0, 0] = trace
    for a in range(3):
        n[0, a + 1] = n[a + 1, 0] = turn[a]
        for b in range(3):
            n[a + 1, b + 1] = s[a][b] + s[b][a] - (trace if a == b else 0)
    return n


def greatest_eigenvector(n):
    """Eigenvalues in descending order, and the vector of the first."""
    values, vectors = mp.eigsy(n)
    order = sorted(range(4), key=lambda i: values[i], reverse=True)
    return [values[i] for i in order], [vectors[row, order[0]] for row in range(4)]


def rotation_of(quaternion):
    """Rows of the rotation of a quaternion, scalar first: the two sides of q p q*."""
    w, *v = quaternion
    length2 = dot(quaternion, quaternion)
    k = [[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]]
    core = w * w - dot(v, v)
    return [
        [((core if a == b else 0) + 2 * v[a] * v[b] + 2 * w * k[a][b]) / length2 for b in range(3)]
        for a in range(3)
    ]
