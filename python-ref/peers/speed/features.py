"""Normals and FPFH."""

import cfreg
import numpy as np

from peers.programs import kiss_matcher, open3d, pcl, small_gicp
from peers.speed import row
from peers.speed.samples import samples
from peers.timing import shortest

NEIGHBORS = 150
NORMAL_SHARE = 0.999
"""KISS-Matcher describes what its normals keep of a surface: their radius is below the features'."""


def reach(points):
    """Median distance to the last of NEIGHBORS, of a hundred points."""
    some = points[:: max(1, len(points) // 100), None]
    distances = np.linalg.norm(points[None, :] - some, axis=2)
    return float(np.median(np.partition(distances, NEIGHBORS, axis=1)[:, NEIGHBORS]))


def alike(ours, theirs, total):
    apart = np.abs(ours - theirs).sum(axis=1)
    return f"L1 of {total}: median {np.median(apart):.0e}, {np.mean(apart > 1):.1%} above 1"


def rows(options):
    for points in (500, 5_000, options.points):
        cloud, _ = samples(points)
        held = cfreg.PointCloud(cloud, viewpoint=(0, 0, 0))
        call = lambda: cfreg.fpfh(held, NEIGHBORS, scale="open3d")
        times, (ours, theirs) = shortest(call, lambda: open3d.fpfh_seen_from(cloud.astype(np.float64), NEIGHBORS, np.zeros(3)))
        same = alike(ours, theirs, 600)
        yield row(f"normals + FPFH, k = {NEIGHBORS}, {len(cloud)} points", *times, "Open3D", same)
    times, ((ours, _), theirs) = shortest(
        lambda: cfreg.estimate_normals(held, NEIGHBORS),
        lambda: small_gicp.normals(cloud, NEIGHBORS, options.threads),
    )
    cosine = np.abs(np.einsum("ij,ij->i", ours, theirs)).clip(0, 1)
    same = f"{np.degrees(np.arccos(np.median(cosine))):.0e} deg apart (median)"
    yield row(f"normals, k = {NEIGHBORS}, {len(cloud)} points", *times, "small_gicp", same)
    what = f"normals + FPFH, {len(cloud)} points"
    radius = reach(cloud)
    near = lambda: cfreg.fpfh(held, NEIGHBORS, scale="pcl")
    (took, _), (ours, (extraction, described)) = shortest(
        near, lambda: kiss_matcher.extraction(cloud, radius, NORMAL_SHARE)
    )
    same = f"{NEIGHBORS} neighbours within its radius (median), {described} points described"
    yield row(what, took, extraction, "KISS-Matcher's extraction", same)
    # Its estimation runs on one thread.
    if options.threads == 1 and pcl.program("described_points") is not None:
        (took, _), (ours, (_, theirs, seconds)) = shortest(
            near, lambda: pcl.described_points(cloud, NEIGHBORS)
        )
        yield row(what, took, seconds, "PCL", alike(ours, theirs, 300))
