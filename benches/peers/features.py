"""Normals and FPFH."""

import cfreg
import numpy as np
import open3d

from .clouds import samples
from .table import row, shortest

NEIGHBORS = 150


def by_open3d(points):
    """FPFH (N, 33) with normals towards the origin."""
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points.astype(np.float64)))
    near = open3d.geometry.KDTreeSearchParamKNN(NEIGHBORS)
    cloud.estimate_normals(near)
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    return open3d.pipelines.registration.compute_fpfh_feature(cloud, near).data.T


def rows(options):
    for points in (500, 5_000, options.points):
        cloud, _ = samples(points)
        held = cfreg.PointCloud(cloud, viewpoint=(0, 0, 0))
        call = lambda: cfreg.fpfh(held, NEIGHBORS, scale="open3d")
        times, (ours, theirs) = shortest(call, lambda: by_open3d(cloud))
        apart = np.abs(ours - theirs).sum(axis=1)
        same = f"L1 of 600: median {np.median(apart):.0e}, {np.mean(apart > 1):.1%} above 1"
        yield row(f"normals + FPFH, k = {NEIGHBORS}, {len(cloud)} points", *times, "Open3D", same)
