"""The crate, by its Python package `cfreg`, which is needed from the first call on only."""

import numpy as np


def register(source, target, method, **settings):
    """The crate's registration."""
    import cfreg

    return cfreg.register(source, target, method, **settings)


def read_points(path):
    """Points (N, 3) of a file, f64."""
    import cfreg

    return np.asarray(cfreg.read(path).points, dtype=np.float64)


def read_seen_from_zero(path):
    """The cloud of a file whose sensor stood at its zero."""
    import cfreg

    return cfreg.PointCloud(cfreg.read(path).points, viewpoint=[0, 0, 0])
