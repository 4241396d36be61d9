"""pycpd: rigid Coherent Point Drift, which always estimates a scale."""

import numpy as np


def register(source, target, outliers, iterations=None, tolerance=None):
    """Scale, rotation (3, 3) and translation (3,)."""
    from pycpd import RigidRegistration

    peer = RigidRegistration(X=target, Y=source, w=outliers, max_iterations=iterations, tolerance=tolerance)
    _, (scale, turn, shift) = peer.register()
    return scale, turn.T, np.ravel(shift)
