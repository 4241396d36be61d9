"""Procedural surfaces: an asymmetric relief, sampled as often as one likes.

No two parts of the relief are alike, so that a registration has one answer, and it
is seen from one side, so that normals have one orientation.
"""

import numpy as np

BUMPS = (
    # centre x, y, height, width
    (-0.55, -0.30, 0.42, 0.28),
    (0.48, 0.22, -0.35, 0.33),
    (0.10, -0.42, 0.25, 0.18),
    (-0.25, 0.38, 0.18, 0.14),
    (0.75, -0.35, 0.30, 0.22),
)
"""Gaussian hills and a pit on [-1, 1] x [-0.7, 0.7], in the unit of the surface."""

VIEWPOINT = np.array([0.25, -0.125, 4.0])
"""A place that sees the whole relief from above."""


def relief(count, rng):
    """`count` points (count, 3) on the relief, uniform over its ground plan, each
    coordinate exactly representable in f32."""
    x = rng.uniform(-1.0, 1.0, count)
    y = rng.uniform(-0.7, 0.7, count)
    z = 0.12 * np.sin(2.3 * x + 0.4) + 0.08 * np.cos(3.1 * y - 1.1 * x)
    for centre_x, centre_y, height, width in BUMPS:
        z += height * np.exp(-((x - centre_x) ** 2 + (y - centre_y) ** 2) / (2 * width**2))
    return as_f32(np.stack([x, y, z], axis=1))


def as_f32(values):
    """f64 values rounded to the nearest f32: both sides see the same numbers."""
    return np.asarray(values, dtype=np.float32).astype(np.float64)
