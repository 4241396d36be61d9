"""Four closed forms for the same pose, each from its own paper.

All minimise sum w |s R p + t - q|² over proper rotations R (paper, eq. 5) and read
nothing but `Moments`. They agree where the minimum is unique: the cross covariance
has rank 2 or more and, when its determinant is negative, two distinct least
singular values. `solve` raises `SingularError` elsewhere.
"""

from dataclasses import dataclass

import numpy as np

from .rotations import cross_matrix

UNIQUE = 1e-9
"""Relative gap of singular values below which a rotation is not unique."""


class SingularError(ValueError):
    """The weights do not determine a rotation."""


@dataclass(frozen=True)
class Pose:
    """p -> scale * rotation @ p + translation, from source to target."""

    scale: float
    rotation: np.ndarray
    """(3, 3)"""
    translation: np.ndarray
    """(3,)"""

    def matrix(self):
        """The homogeneous (4, 4) matrix T_target_source."""
        result = np.eye(4)
        result[:3, :3] = self.scale * self.rotation
        result[:3, 3] = self.translation
        return result


def solve(sums, solver="arun", scale="fixed"):
    """The pose of least weighted residual.

    `scale` is "fixed" (s = 1), "umeyama" (S. Umeyama, PAMI 1991, eq. 42: the
    s that minimises the residual over source and target for the rotation found) or
    "symmetric" (Horn, JOSA A 1987, section 2.E: the ratio of the clouds' spreads).
    """
    _require_unique(sums)
    rotation = SOLVERS[solver](sums)
    if scale == "fixed":
        # Walker et al. find rotation and translation together.
        if solver == "walker":
            translation = _walker_translation(sums, rotation)
            return Pose(1.0, rotation, translation)
        factor = 1.0
    elif scale == "umeyama":
        factor = np.trace(rotation @ sums.centred_cross()) / sums.centred_source_squares()
    elif scale == "symmetric":
        factor = np.sqrt(sums.centred_target_squares() / sums.centred_source_squares())
    else:
        raise ValueError(f"scale must be fixed, umeyama or symmetric, not {scale!r}")
    p_mean = sums.source_origin + sums.source_mean()
    q_mean = sums.target_origin + sums.target_mean()
    return Pose(float(factor), rotation, q_mean - factor * rotation @ p_mean)


def arun(sums):
    """Rotation by singular values (Arun, Huang, Blostein, PAMI 1987; paper III-A).

    U S V^T = X W Y^T, R = V U^T; if |V||U| < 0 the last column of V changes sign.
    """
    u, _, v_transposed = np.linalg.svd(sums.centred_cross())
    v = v_transposed.T
    if np.linalg.det(v) * np.linalg.det(u) < 0:
        v[:, 2] = -v[:, 2]
    return v @ u.T


def horn_quaternion(sums):
    """Rotation by a unit quaternion (Horn, JOSA A 1987, section 4.A).

    The eigenvector of the greatest eigenvalue of the symmetric 4 x 4 matrix N, made
    of the sums S_ab = sum w x_a y_b.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = sums.centred_cross()
    n = np.array(
        [
            [xx + yy + zz, yz - zy, zx - xz, xy - yx],
            [yz - zy, xx - yy - zz, xy + yx, zx + xz],
            [zx - xz, xy + yx, -xx + yy - zz, yz + zy],
            [xy - yx, zx + xz, yz + zy, -xx - yy + zz],
        ]
    )
    _, vectors = np.linalg.eigh(n)
    q0, qx, qy, qz = vectors[:, -1]
    return np.array(
        [
            [q0**2 + qx**2 - qy**2 - qz**2, 2 * (qx * qy - q0 * qz), 2 * (qx * qz + q0 * qy)],
            [2 * (qy * qx + q0 * qz), q0**2 - qx**2 + qy**2 - qz**2, 2 * (qy * qz - q0 * qx)],
            [2 * (qz * qx - q0 * qy), 2 * (qz * qy + q0 * qx), q0**2 - qx**2 - qy**2 + qz**2],
        ]
    )


def horn_matrix(sums):
    """Rotation by the square root of a matrix (Horn, Hilden, Negahdaripour, JOSA A
    1988): R = M (M^T M)^(-1/2) with M = sum w y x^T = (X W Y^T)^T.

    With l_i, u_i the eigenpairs of M^T M that is sum_i M u_i u_i^T / sqrt(l_i). The
    term of the least eigenvalue is written as in the paper's case of rank 2, by the
    direction normal to the other two with the sign that makes R proper: for rank 3
    and |M| > 0 this is the same, for rank 2 the paper's, and for |M| < 0 the sign
    which Umeyama (PAMI 1991, eq. 43) shows to be the best.
    """
    m = sums.centred_cross().T
    values, vectors = np.linalg.eigh(m.T @ m)
    u1, u2 = vectors[:, 2], vectors[:, 1]
    r1 = m @ u1 / np.sqrt(values[2])
    r2 = m @ u2 / np.sqrt(values[1])
    return np.outer(r1, u1) + np.outer(r2, u2) + np.outer(np.cross(r1, r2), np.cross(u1, u2))


def walker(sums):
    """Rotation by a dual quaternion (Walker, Shao, Volz, CVGIP 1991): the real part
    r = (r1, r2, r3, r4), scalar last."""
    real, _ = _dual_quaternion(sums)
    return (_q_matrix(real) @ _w_matrix(real).T)[:3, :3]


SOLVERS = {
    "arun": arun,
    "horn-quaternion": horn_quaternion,
    "horn-matrix": horn_matrix,
    "walker": walker,
}
"""Rotation (3, 3) from moments, by name."""


def _dual_quaternion(sums):
    """The dual quaternion (real, dual), (4,) each, of Walker et al. about the origins.

    They minimise r^T C1 r + w s^T s + s^T C3 r with |r| = 1 and r^T s = 0:
    C1 = -2 sum w Q(q)^T W(p), C2 = sum w I, C3 = 2 sum w (W(p) - Q(q)), points being
    the quaternions (p / 2, 0). Then r is the eigenvector of the greatest eigenvalue
    of A = (C3^T (C2 + C2^T)^-1 C3 - C1 - C1^T) / 2, and s = -(C2 + C2^T)^-1 C3 r.
    Q and W are linear, so that the sums over points come from the moments.
    """
    axes = np.eye(4)[:3]
    c1 = np.zeros((4, 4))
    for a in range(3):
        for b in range(3):
            c1 -= 2.0 * sums.cross[a, b] / 4.0 * _q_matrix(axes[b]).T @ _w_matrix(axes[a])
    c3 = 2.0 * (_w_matrix(_half(sums.source_sum)) - _q_matrix(_half(sums.target_sum)))
    inverse = 1.0 / (2.0 * sums.weight)
    a_matrix = 0.5 * (inverse * c3.T @ c3 - c1 - c1.T)
    _, vectors = np.linalg.eigh(a_matrix)
    real = vectors[:, -1]
    return real, -inverse * c3 @ real


def _walker_translation(sums, rotation):
    """t = W(r)^T s about the origins, doubled since a quaternion holds half of it."""
    real, dual = _dual_quaternion(sums)
    local = 2.0 * (_w_matrix(real).T @ dual)[:3]
    return local + sums.target_origin - rotation @ sums.source_origin


def _half(vector):
    return np.append(0.5 * vector, 0.0)


def _q_matrix(r):
    """Q(r) (4, 4) with Q(a) b = a b, the product of quaternions, scalar last."""
    return np.block([[r[3] * np.eye(3) + cross_matrix(r), r[:3, None]], [-r[None, :3], r[3]]])


def _w_matrix(r):
    """W(r) (4, 4) with W(b) a = a b."""
    return np.block([[r[3] * np.eye(3) - cross_matrix(r), r[:3, None]], [-r[None, :3], r[3]]])


def _require_unique(sums):
    """Raise unless one rotation alone is best.

    With singular values s1 >= s2 >= s3 and the sign e of the determinant, rotations
    other than the best lose at least 2 (s2 + e s3) per unit of angle.
    """
    if not sums.weight > 0:
        raise SingularError("no connection has a weight")
    cross = sums.centred_cross()
    s1, s2, s3 = np.linalg.svd(cross, compute_uv=False)
    least = s2 + np.sign(np.linalg.det(cross)) * s3
    spread = np.sqrt(sums.centred_source_squares() * sums.centred_target_squares())
    if not (least > UNIQUE * s1 and s1 > UNIQUE * spread):
        raise SingularError(f"singular values {s1:.3g}, {s2:.3g}, {s3:.3g}: rotation not unique")
