"""The few sums over all weighted connections from which a pose follows.

With p' = p - source_origin and q' = q - target_origin the sums are over all pairs
(i, j) with weight w = w_ij. They are all that the solvers read, and also give the
weighted residual of *any* pose, because |s R p + t - q|² is a polynomial in them.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Moments:
    """Sums over N x M connections, in the clouds' length unit L."""

    weight: float
    """sum w"""
    weight_squared: float
    """sum w²"""
    source_sum: np.ndarray
    """sum w p', (3,), L"""
    target_sum: np.ndarray
    """sum w q', (3,), L"""
    cross: np.ndarray
    """sum w p' q'^T, (3, 3), rows belong to the source, L²"""
    source_squares: float
    """sum w |p'|², L²"""
    target_squares: float
    """sum w |q'|², L²"""
    source_origin: np.ndarray
    """(3,), L"""
    target_origin: np.ndarray
    """(3,), L"""

    def source_mean(self):
        """The weighted mean of p' (3,): p-bar of the paper, less the origin."""
        return self.source_sum / self.weight

    def target_mean(self):
        """The weighted mean of q' (3,)."""
        return self.target_sum / self.weight

    def centred_cross(self):
        """X W Y^T of the paper (3, 3): sum w (p - p-bar)(q - q-bar)^T."""
        return self.cross - np.outer(self.source_sum, self.target_sum) / self.weight

    def centred_source_squares(self):
        """sum w |p - p-bar|²."""
        return self.source_squares - self.source_sum @ self.source_sum / self.weight

    def centred_target_squares(self):
        """sum w |q - q-bar|²."""
        return self.target_squares - self.target_sum @ self.target_sum / self.weight


def moments(
    weights,
    source,
    target,
    source_origin=None,
    target_origin=None,
    source_weights=None,
    target_weights=None,
):
    """The moments of (N, M) weights, source (N, 3) and target (M, 3).

    Weights of the points, (N,) and (M,), multiply those of their pairs, normalised before.

    Origins default to the clouds' unweighted means: far from the origin second
    moments would lose digits.
    """
    source = np.asarray(source, dtype=np.float64)
    target = np.asarray(target, dtype=np.float64)
    source_origin = source.mean(axis=0) if source_origin is None else np.array(source_origin)
    target_origin = target.mean(axis=0) if target_origin is None else np.array(target_origin)
    p, q = source - source_origin, target - target_origin
    if source_weights is not None:
        weights = np.asarray(source_weights, dtype=np.float64)[:, None] * weights
    if target_weights is not None:
        weights = weights * np.asarray(target_weights, dtype=np.float64)
    by_source, by_target = weights.sum(axis=1), weights.sum(axis=0)
    return Moments(
        weight=float(weights.sum()),
        weight_squared=float(np.vdot(weights, weights)),
        source_sum=by_source @ p,
        target_sum=by_target @ q,
        cross=p.T @ weights @ q,
        source_squares=float(by_source @ (p * p).sum(axis=1)),
        target_squares=float(by_target @ (q * q).sum(axis=1)),
        source_origin=source_origin,
        target_origin=target_origin,
    )


def effective_connections(sums):
    """(sum w)² / sum w²: how many equal connections would be as many."""
    return sums.weight**2 / sums.weight_squared


def weighted_residual(sums, scale, rotation, translation):
    """sum w |s R p + t - q|² (paper, eq. 5) of any pose, from the moments alone."""
    # With x = p - p-bar, y = q - q-bar and e = s R p-bar + t - q-bar the mixed terms
    # vanish: sum w |s R x - y|² + |e|² sum w.
    spread = (
        scale**2 * sums.centred_source_squares()
        + sums.centred_target_squares()
        - 2.0 * scale * np.trace(rotation @ sums.centred_cross())
    )
    p_mean = sums.source_origin + sums.source_mean()
    q_mean = sums.target_origin + sums.target_mean()
    offset = scale * rotation @ p_mean + translation - q_mean
    return float(spread + sums.weight * (offset @ offset))
