"""Density adaptive point set registration (Järemo Lawin, Danelljan, Khan, Forssén and
Felsberg, CVPR 2018), positions only, with N x K matrices.

Both clouds are drawn from one latent scene, K isotropic Gaussians of equal priors and
uniform outliers. Maximised is the log-likelihood of the points, each weighed by how much
of the surface it stands for. With equal weights this is JRMPC (Evangelidis and Horaud,
PAMI 2018).

The papers leave the start open. Here: clouds about their centroids in root mean square
radii of the target; means evenly on a sphere, by the golden angle, that turns with the
target; one wide variance. Points count as blurred by `min_sigma`, a variance that the
authors' program adds in the M-step alone: with the expected squared distance in both
steps the likelihood never falls.
"""

from dataclasses import dataclass

import numpy as np

from .moments import moments
from .neighbours import nearest
from .pose import Pose, solve
from .weights import squared_distances

HELD = 3
"""First iterations, in which the means stay (the authors' program)."""
CAP = 8.0
"""Most that a point weighs, in mean weights (the authors' program)."""


@dataclass(frozen=True)
class Step:
    """One EM step."""

    pose: Pose
    """Source to target, after the step."""
    log_likelihood: float
    """sum w ln p(T x) over both clouds before the step, in units of the model."""
    weight: float
    """Share of both clouds that the Gaussians explain, at most 2."""
    sigma: float
    """Root mean square of the standard deviations after the step, in the clouds' unit."""


def dare(
    source,
    target,
    components,
    outlier_ratio=0.005,
    density_neighbors=10,
    iterations=50,
    initial_sigma=3.0,
    min_sigma=0.065,
):
    """`iterations` EM steps from the identity, as a list of `Step`."""
    centers = source.mean(axis=0), target.mean(axis=0)
    unit = np.sqrt(squared_distances(target, centers[1][None]).mean())
    views = [(cloud - center) / unit for cloud, center in zip((source, target), centers)]
    observed = [observation_weights(view, density_neighbors) for view in views]
    poses = [Pose(1.0, np.eye(3), (centers[0] - centers[1]) / unit), Pose(1.0, np.eye(3), np.zeros(3))]

    everything = np.vstack([moved(view, pose) for view, pose in zip(views, poses)])
    spread = everything.var(axis=0).sum()
    means = everything.mean(axis=0) + np.sqrt(spread / 3.0) * golden_sphere(components) @ axes(views[1])
    variances = np.full(components, initial_sigma**2 * spread)
    radius = max(np.linalg.norm(view, axis=1).max() for view in views)
    outlier_density = outlier_ratio / (4.0 / 3.0 * np.pi * radius**3)
    prior = (1.0 - outlier_ratio) / components

    steps = []
    for iteration in range(iterations):
        # E: how much of each point each Gaussian answers for.
        shares, log_likelihood = [], 0.0
        for view, pose, weights in zip(views, poses, observed):
            d2 = squared_distances(moved(view, pose), means)
            expected = d2 + 3.0 * min_sigma**2
            joint = prior * (2 * np.pi * variances) ** -1.5 * np.exp(-expected / (2 * variances))
            density = joint.sum(axis=1) + outlier_density
            shares.append(weights[:, None] * joint / density[:, None])
            log_likelihood += float(weights @ np.log(density))
        # M: the poses, the means (later), the variances.
        poses = [
            solve(moments(share / variances, view, means)) for share, view in zip(shares, views)
        ]
        points = np.vstack([moved(view, pose) for view, pose in zip(views, poses)])
        share = np.vstack(shares)
        mass = share.sum(axis=0)
        if iteration >= HELD:
            means = share.T @ points / mass[:, None]
        d2 = squared_distances(points, means)
        variances = (share * d2).sum(axis=0) / (3.0 * mass) + min_sigma**2
        # Only the poses' difference means anything: the target's becomes the identity.
        first, second = poses
        back = second.rotation.T
        means = (means - second.translation) @ second.rotation
        relative = Pose(
            1.0, back @ first.rotation, back @ (first.translation - second.translation)
        )
        poses = [relative, Pose(1.0, np.eye(3), np.zeros(3))]
        shift = unit * relative.translation + centers[1] - relative.rotation @ centers[0]
        found = Pose(1.0, relative.rotation, shift)
        sigma = unit * np.sqrt(variances.mean())
        steps.append(Step(found, log_likelihood, float(share.sum()), float(sigma)))
    return steps


def observation_weights(points, neighbors):
    """Weights (N,) of sum 1, inverse to the sampling density, after the empirical sample
    model: the area that the `neighbors` nearest points span (itself one of them), by the
    two largest standard deviations, then the median over the same points. 0: equal."""
    if neighbors == 0:
        return np.full(len(points), 1.0 / len(points))
    indices, _ = nearest(points, neighbors)
    deviations = np.array([np.sqrt(principal_variances(points[row])) for row in indices])
    areas = deviations[:, 1] * deviations[:, 2]
    weights = np.median(areas[indices], axis=1)
    weights = np.minimum(weights, CAP * weights.mean())
    return weights / weights.sum()


def principal_variances(points):
    """Ascending, (3,)."""
    return np.maximum(np.linalg.eigvalsh(np.cov(points.T, bias=True)), 0.0)


def axes(points):
    """Principal axes as rows, right-handed: the widest first, each of the first two
    towards its longer tail."""
    _, vectors = np.linalg.eigh(points.T @ points)
    first, second = (axis * np.sign(((points @ axis) ** 3).sum()) for axis in vectors.T[:0:-1])
    return np.stack([first, second, np.cross(first, second)])


def golden_sphere(count):
    """(count, 3) even directions by the golden angle (González 2010)."""
    i = np.arange(count)
    z = 1.0 - (2 * i + 1) / count
    turn = i * np.pi * (3.0 - np.sqrt(5.0))
    return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)


def moved(points, pose):
    return points @ pose.rotation.T + pose.translation
