"""Normals and FPFH."""

import importlib.util
import subprocess
import tempfile
from pathlib import Path

import cfreg
import kiss_matcher
import numpy as np
import open3d
import small_gicp

from .clouds import REPOSITORY, samples
from .table import row, shortest

NEIGHBORS = 150
# KISS-Matcher's kept surface alone is described, with normals of a radius below the features'.
NORMAL_SHARE = 0.999


def by_open3d(points):
    """FPFH (N, 33) with normals towards the origin."""
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points.astype(np.float64)))
    near = open3d.geometry.KDTreeSearchParamKNN(NEIGHBORS)
    cloud.estimate_normals(near)
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    return open3d.pipelines.registration.compute_fpfh_feature(cloud, near).data.T


def normals_by_small_gicp(points, threads):
    """Unit normals (N, 3), of either sign."""
    cloud = small_gicp.PointCloud(points.astype(np.float64))
    tree = small_gicp.KdTree(cloud, num_threads=threads)
    small_gicp.estimate_normals(cloud, tree, num_neighbors=NEIGHBORS, num_threads=threads)
    return cloud.normals()[:, :3]


def reach(points):
    """Median distance to the last of NEIGHBORS, of a hundred points."""
    some = points[:: max(1, len(points) // 100), None]
    distances = np.linalg.norm(points[None, :] - some, axis=2)
    return float(np.median(np.partition(distances, NEIGHBORS, axis=1)[:, NEIGHBORS]))


def by_kiss_matcher(points, radius):
    """Seconds that the extraction of a cloud takes, and how many points it describes."""
    config = kiss_matcher.KISSMatcherConfig(
        voxel_size=radius,
        use_voxel_sampling=False,
        normal_r_gain=NORMAL_SHARE,
        fpfh_r_gain=1.0,
    )
    matcher = kiss_matcher.KISSMatcher(config)
    # Of a pair: the other side is a hundred points.
    matcher.match(list(points), list(points[:100]))
    return matcher.get_extraction_time(), len(matcher.get_keypoints_from_faster_pfh()[0])


def pcl_program():
    """The program that describes a cloud by PCL, or None where PCL is not installed."""
    path = REPOSITORY / "python-ref" / "pcl" / "programs.py"
    spec = importlib.util.spec_from_file_location("pcl_programs", path)
    programs = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(programs)
    return programs.build("described_points")


def by_pcl(program, points):
    """Seconds of normals and FPFH, and FPFH (N, 33); normals towards the origin."""
    with tempfile.TemporaryDirectory() as folder:
        cloud, out = Path(folder) / "cloud.txt", Path(folder) / "out.txt"
        np.savetxt(cloud, points, fmt="%.9g")
        command = [program, cloud, out, str(NEIGHBORS)]
        took = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        return float(took), np.loadtxt(out)[:, 3:]


def alike(ours, theirs, total):
    apart = np.abs(ours - theirs).sum(axis=1)
    return f"L1 of {total}: median {np.median(apart):.0e}, {np.mean(apart > 1):.1%} above 1"


def rows(options):
    for points in (500, 5_000, options.points):
        cloud, _ = samples(points)
        held = cfreg.PointCloud(cloud, viewpoint=(0, 0, 0))
        call = lambda: cfreg.fpfh(held, NEIGHBORS, scale="open3d")
        times, (ours, theirs) = shortest(call, lambda: by_open3d(cloud))
        same = alike(ours, theirs, 600)
        yield row(f"normals + FPFH, k = {NEIGHBORS}, {len(cloud)} points", *times, "Open3D", same)
    times, ((ours, _), theirs) = shortest(
        lambda: cfreg.estimate_normals(held, NEIGHBORS),
        lambda: normals_by_small_gicp(cloud, options.threads),
    )
    cosine = np.abs(np.einsum("ij,ij->i", ours, theirs)).clip(0, 1)
    same = f"{np.degrees(np.arccos(np.median(cosine))):.0e} deg apart (median)"
    yield row(f"normals, k = {NEIGHBORS}, {len(cloud)} points", *times, "small_gicp", same)
    what = f"normals + FPFH, {len(cloud)} points"
    radius = reach(cloud)
    near = lambda: cfreg.fpfh(held, NEIGHBORS, scale="pcl")
    (took, _), (ours, (extraction, described)) = shortest(
        near, lambda: by_kiss_matcher(cloud, radius)
    )
    same = f"{NEIGHBORS} neighbours within its radius (median), {described} points described"
    yield row(what, took, extraction, "KISS-Matcher's extraction", same)
    # Its estimation runs on one thread.
    if options.threads == 1 and (program := pcl_program()) is not None:
        (took, _), (ours, (seconds, theirs)) = shortest(near, lambda: by_pcl(program, cloud))
        yield row(what, took, seconds, "PCL", alike(ours, theirs, 300))
