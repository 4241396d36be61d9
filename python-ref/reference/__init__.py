"""Registration on the full connection, written plainly in f64 from the papers.

This package is the oracle of the crate: it shares no code with it and prefers the
formula as printed to speed. One story a module, in the order of the pipeline:

    neighbours -> normals -> fpfh -> weights -> moments -> pose

Everywhere: clouds are (N, 3) arrays of points in rows, `source` is moved onto
`target`, and a pose (scale, R, t) maps a source point p to scale * R @ p + t.
"""

from .fpfh import fpfh
from .moments import Moments, effective_connections, moments, weighted_residual
from .neighbours import nearest, separation
from .normals import normals
from .paper import BETA, NEIGHBORS
from .pose import SOLVERS, Pose, SingularError, solve
from .weights import KERNELS, NORMALISATIONS, normalise, squared_distances, weigh

__all__ = [
    "BETA",
    "KERNELS",
    "NEIGHBORS",
    "NORMALISATIONS",
    "SOLVERS",
    "Moments",
    "Pose",
    "SingularError",
    "effective_connections",
    "fpfh",
    "moments",
    "nearest",
    "normalise",
    "normals",
    "register",
    "separation",
    "solve",
    "squared_distances",
    "weigh",
    "weighted_residual",
]


def register(
    source,
    target,
    neighbors=NEIGHBORS,
    beta=BETA,
    solver="arun",
    source_viewpoint=(0.0, 0.0, 0.0),
    target_viewpoint=(0.0, 0.0, 0.0),
):
    """The method of the paper (section III) from two clouds to a pose.

    Normals and FPFH over the same `neighbors` points, Gaussian weights of the
    descriptors' distance (eq. for w_i, III-B), one closed-form solve (III-A).

    Normals are rounded to f32, as clouds keep them. Without that, points with the
    same neighbours would have normals that differ by noise, and noise would decide
    which of two such points comes first in their pair (see `pair_features`).
    """
    described = []
    for cloud, viewpoint in ((source, source_viewpoint), (target, target_viewpoint)):
        oriented, _ = normals(cloud, neighbors, viewpoint)
        described.append(fpfh(cloud, oriented.astype("float32"), neighbors, "pcl"))
    weights = weigh(squared_distances(*described), "gaussian", beta)
    return solve(moments(weights, source, target), solver)
