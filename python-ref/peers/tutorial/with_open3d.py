"""The job of the tutorial with Open3D's API, as Open3D's own tutorials do it.

    python -m peers.tutorial.with_open3d SOURCE TARGET VOXEL [--output aligned_open3d.png]

VOXEL, a length in the unit of the clouds, has to be chosen: 0.003 for the bunny. Five more
lengths and thresholds follow from it by rules of thumb. The answer has a fitness, whose
meaning depends on them, and no verdict.
"""

import argparse

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import open3d as o3d

registration = o3d.pipelines.registration


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source")
    parser.add_argument("target")
    parser.add_argument("voxel", type=float)
    parser.add_argument("--output", default="aligned_open3d.png")
    options = parser.parse_args()
    source, target = (o3d.io.read_point_cloud(path) for path in (options.source, options.target))
    found = register(source, target, options.voxel)
    print(found.transformation, found.fitness, found.inlier_rmse)
    draw(source.transform(found.transformation), target, options.output)


def register(source, target, voxel):
    o3d.utility.random.seed(0)
    (a, a_features), (b, b_features) = (prepared(cloud, voxel) for cloud in (source, target))
    distance = 1.5 * voxel
    coarse = registration.registration_ransac_based_on_feature_matching(
        a,
        b,
        a_features,
        b_features,
        True,
        distance,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(distance),
        ],
        registration.RANSACConvergenceCriteria(100000, 0.999),
    )
    plane = registration.TransformationEstimationPointToPlane()
    return registration.registration_icp(a, b, 0.4 * voxel, coarse.transformation, plane)


def prepared(cloud, voxel):
    """The cloud thinned, with normals that look at its sensor, and its features."""
    cloud = cloud.voxel_down_sample(voxel)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=2.0 * voxel, max_nn=30))
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    around = o3d.geometry.KDTreeSearchParamHybrid(radius=5.0 * voxel, max_nn=100)
    return cloud, registration.compute_fpfh_feature(cloud, around)


def draw(moved, target, path):
    figure, axis = plt.subplots(figsize=(5, 4.5), layout="constrained")
    for cloud, colour in ((target, "#2f6f9f"), (moved, "#e07b39")):
        points = np.asarray(cloud.points)[::5]
        axis.scatter(points[:, 0], points[:, 1], s=0.6, color=colour, linewidths=0)
    axis.set(aspect="equal", xlabel="x", ylabel="y", title="Open3D")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()
