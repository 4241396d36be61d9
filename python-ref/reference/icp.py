"""Iterative closest point, one step a line of the papers, with N x M distances.

Pairs: Besl and McKay (PAMI 1992, section III-A): the closest target point of every source
point under the pose so far; kept are those within a bound, those that are each other's
closest, the shortest share (Chetverikov et al., ICPR 2002), weighed by a kernel.

Steps, from pairs (p, q) and a pose T:

point        the closed form of sum w |R p + t - q|² (Besl and McKay, section III-C)
plane        sum w (n_q . (T p - q))² (Chen and Medioni, ICRA 1991, eq. 10)
generalized  sum w e^T (C_q + R C_p R^T)^-1 e, e = T p - q (Segal, Haehnel and Thrun, RSS
             2009, eq. 2 and section III-C: C = discs of thickness 1e-3)

The last two have no closed form: a step is one of Gauss and Newton's, with the matrix of a
pair as the pose before makes it, and motions about the target's centroid.
"""

from dataclasses import dataclass

import numpy as np

from .moments import moments
from .normals import normals
from .pose import solve
from .rotations import cross_matrix, from_vector
from .weights import squared_distances, weigh

THICKNESS = 1e-3
"""Variance of a disc along its normal, where it is 1 across."""


@dataclass(frozen=True)
class Step:
    rotation: np.ndarray
    """(3, 3), of the pose after the step."""
    translation: np.ndarray
    """(3,)"""
    objective: float
    """Root mean square distance of the pairs (weighted) at the pose before."""
    weight: float
    """Sum of the weights."""
    clear: float
    """Least difference of two distances by which a pair was chosen or left."""


def icp(
    source,
    target,
    metric="point",
    max_distance=None,
    keep=1.0,
    reciprocal=False,
    weights="uniform",
    bandwidth=1.0,
    surface_neighbors=20,
    max_iterations=10,
):
    """The steps of so many iterations from the identity."""
    step = {"point": closed_form, "plane": to_planes, "generalized": to_discs}[metric]
    surfaces = [normals(cloud, surface_neighbors)[0] for cloud in (source, target)]
    rotation, translation = np.eye(3), np.zeros(3)
    steps = []
    for _ in range(max_iterations):
        d2 = squared_distances(source @ rotation.T + translation, target)
        chosen, clear = closest(np.sqrt(d2), max_distance, keep, reciprocal)
        w = np.where(chosen, weigh(d2 / bandwidth**2, weights, 1.0), 0.0)
        objective = np.sqrt((w * d2).sum() / w.sum())
        rotation, translation = step(w, source, target, surfaces, rotation, translation)
        steps.append(Step(rotation, translation, float(objective), float(w.sum()), clear))
    return steps


def closest(distances, max_distance, keep, reciprocal):
    """Which of the (N, M) connections are pairs, and how clearly."""
    rows = np.arange(len(distances))
    first, second = np.partition(distances, 1, axis=1)[:, :2].T
    partner, pairs = distances.argmin(axis=1), np.ones(len(distances), dtype=bool)
    clear = [(second - first).min()]
    if max_distance is not None:
        pairs &= first <= max_distance
        clear.append(np.abs(first - max_distance).min())
    if reciprocal:
        there = distances[:, partner]
        pairs &= there.argmin(axis=0) == rows
        nearest, next_one = np.partition(there, 1, axis=0)[:2]
        clear.append((next_one - nearest).min())
    if keep < 1.0:
        count = int(np.ceil(keep * pairs.sum()))
        order = np.sort(first[pairs])
        clear.append(order[count] - order[count - 1])
        pairs &= first <= order[count - 1]
    chosen = np.zeros(distances.shape, dtype=bool)
    chosen[rows[pairs], partner[pairs]] = True
    return chosen, float(min(clear))


def closed_form(w, source, target, _surfaces, _rotation, _translation):
    pose = solve(moments(w, source, target), "arun")
    return pose.rotation, pose.translation


def to_planes(w, source, target, surfaces, rotation, translation):
    return gauss_newton(w, source, target, rotation, translation, lambda i, j: plane(surfaces[1][j]))


def to_discs(w, source, target, surfaces, rotation, translation):
    def inverse_covariance(i, j):
        return np.linalg.inv(disc(surfaces[1][j]) + rotation @ disc(surfaces[0][i]) @ rotation.T)

    return gauss_newton(w, source, target, rotation, translation, inverse_covariance)


def plane(normal):
    return np.outer(normal, normal)


def disc(normal):
    """Covariance: THICKNESS along the normal, 1 across."""
    return np.eye(3) - (1.0 - THICKNESS) * plane(normal)


def gauss_newton(w, source, target, rotation, translation, matrix):
    """Sum w e^T M e, e linear in a small motion (turn a, shift b) about the centroid c:
    e(a, b) = e + a x (T p - c) + b."""
    center = target.mean(axis=0)
    curvature, gradient = np.zeros((6, 6)), np.zeros(6)
    for i, j in np.argwhere(w > 0):
        arm = rotation @ source[i] + translation - center
        jacobian = np.hstack([-cross_matrix(arm), np.eye(3)])
        error = arm + center - target[j]
        curvature += w[i, j] * jacobian.T @ matrix(i, j) @ jacobian
        gradient += w[i, j] * jacobian.T @ matrix(i, j) @ error
    motion = np.linalg.solve(curvature, -gradient)
    turn = from_vector(motion[:3])
    return turn @ rotation, turn @ (translation - center) + center + motion[3:]
