"""The paper's own way from two clouds to a pose: PCL's normals, FPFH and SIFT keypoints
(`pcl/described_points.cpp`), then its weights, moments and closed form (the reference)."""

import reference as ref
from peers.programs import pcl


def pose(source, target, k=ref.NEIGHBORS, beta=ref.BETA, sifts=(None, None)):
    """The published answer (4, 4), and how many points of each cloud it connects; None
    where the weights leave the rotation open."""
    sides = [pcl.described_points(cloud, k, sift)[:2] for cloud, sift in zip((source, target), sifts)]
    counts = [len(places) for places, _ in sides]
    if min(counts) < 3:
        return None, counts
    (p, a), (q, b) = sides
    try:
        found = ref.solve(ref.moments(ref.weigh(ref.squared_distances(a, b), "gaussian", beta), p, q))
    except ref.SingularError:
        return None, counts
    return found.matrix(), counts
