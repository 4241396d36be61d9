"""Open3D, or one line that says which Debian packages it lacks.

Its wheel links against libraries of a desktop, which servers and containers often do not
have; the loader's own message names one file at a time. `python -m peers.programs.open3d` tries.
"""

import sys

import numpy as np

PACKAGES = "libusb-1.0-0 libgl1 libegl1 libgomp1 libx11-6"
"""Debian 12 packages that the wheel of Open3D 0.20.0 loads."""


def import_open3d():
    """The module open3d; ends the program with one line where it cannot be loaded."""
    try:
        import open3d
    except ModuleNotFoundError as error:
        sys.exit(f"{error}: install it with `pip install -r requirements.txt`")
    except (ImportError, OSError) as error:
        sys.exit(f"open3d cannot be loaded ({error}): apt-get install {PACKAGES}")
    return open3d


def seed(number):
    """Starts its random numbers anew."""
    import_open3d().utility.random.seed(number)


def read_points(path):
    """Points (N, 3) of a file, f64; none where it cannot be read."""
    return np.asarray(import_open3d().io.read_point_cloud(str(path)).points)


def read_mesh(path):
    """Vertices (V, 3) and triangles (F, 3) of a file."""
    mesh = import_open3d().io.read_triangle_mesh(str(path))
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles)


def cloud(points, normals=None):
    """An Open3D cloud of arrays (N, 3)."""
    o3d = import_open3d()
    made = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is not None:
        made.normals = o3d.utility.Vector3dVector(normals)
    return made


# --- features ------------------------------------------------------------------------


def normals(points, k, viewpoint):
    """Unit normals (N, 3) of k neighbours, on the viewpoint's side."""
    made = cloud(points)
    # The fast way solves a cubic and loses digits where eigenvalues are close.
    made.estimate_normals(nearest(k), fast_normal_computation=False)
    made.orient_normals_towards_camera_location(viewpoint)
    return np.asarray(made.normals)


def fpfh(points, normals, k):
    """FPFH (N, 33) of k neighbours from given normals."""
    return feature(cloud(points, normals), nearest(k)).data.T


def fpfh_seen_from(points, k, viewpoint):
    """FPFH (N, 33) of k neighbours from its own normals, estimated the fast way."""
    made = cloud(points)
    made.estimate_normals(nearest(k))
    made.orient_normals_towards_camera_location(viewpoint)
    return feature(made, nearest(k)).data.T


def feature_cloud(points, viewpoint, normal_radius, max_normal_neighbors, fpfh_radius, max_fpfh_neighbors, voxel=None):
    """A cloud, downsampled where a voxel is given, and its FPFH, both as Open3D has them: of the
    points within a radius, so many at most. `ransac`, `fast_global` and `matches` take it."""
    made = cloud(points)
    if voxel is not None:
        made = made.voxel_down_sample(voxel)
    made.estimate_normals(within(normal_radius, max_normal_neighbors))
    made.orient_normals_towards_camera_location(viewpoint)
    return made, feature(made, within(fpfh_radius, max_fpfh_neighbors))


def feature(made, search):
    return import_open3d().pipelines.registration.compute_fpfh_feature(made, search)


def nearest(k):
    return import_open3d().geometry.KDTreeSearchParamKNN(k)


def within(radius, max_neighbors):
    return import_open3d().geometry.KDTreeSearchParamHybrid(radius, max_neighbors)


def iss(points, salient_radius, non_max_radius, gamma21, gamma32, min_neighbors):
    """Places (n, 3) of the ISS keypoints."""
    keypoint = import_open3d().geometry.keypoint
    found = keypoint.compute_iss_keypoints(
        cloud(points), salient_radius, non_max_radius, gamma21, gamma32, min_neighbors
    )
    return np.asarray(found.points)


# --- poses ---------------------------------------------------------------------------


def ransac(source, target, distance, edge_length=0.9, iterations=100_000, confidence=0.999):
    """Pose by RANSAC of three mutual matches of two `feature_cloud`s, as Open3D's tutorial has it;
    the distance is the longest of a pair that counts."""
    registration = import_open3d().pipelines.registration
    return registration.registration_ransac_based_on_feature_matching(
        source[0],
        target[0],
        source[1],
        target[1],
        mutual_filter=True,
        max_correspondence_distance=distance,
        checkers=[
            registration.CorrespondenceCheckerBasedOnEdgeLength(edge_length),
            registration.CorrespondenceCheckerBasedOnDistance(distance),
        ],
        criteria=registration.RANSACConvergenceCriteria(iterations, confidence),
    ).transformation


def fast_global(source, target, distance):
    """Pose by fast global registration of two `feature_cloud`s."""
    registration = import_open3d().pipelines.registration
    option = registration.FastGlobalRegistrationOption(maximum_correspondence_distance=distance)
    return registration.registration_fgr_based_on_feature_matching(
        source[0], target[0], source[1], target[1], option
    ).transformation


def matches(source, target):
    """(n, 2) indices: each source point of two `feature_cloud`s and the target point of the nearest
    descriptor."""
    registration = import_open3d().pipelines.registration
    return np.asarray(
        registration.correspondences_from_features(source[1], target[1], mutual_filter=False)
    )


def iterative_closest_point(
    metric, source, target, max_distance, initial=np.eye(4), tolerance=1e-9, max_iterations=200, neighbors=20
):
    """Pose by ICP from point to `point`, to `plane` or `generalized`, of arrays or clouds; those
    without normals get normals of so many neighbours where the metric needs them."""
    registration = import_open3d().pipelines.registration
    criteria = registration.ICPConvergenceCriteria(tolerance, tolerance, max_iterations)
    source, target = (cloud(c) if isinstance(c, np.ndarray) else c for c in (source, target))
    arguments = source, target, max_distance, initial
    if metric == "generalized":
        # Its own discs: 20 neighbours, thickness 1e-3.
        estimation = registration.TransformationEstimationForGeneralizedICP()
        found = registration.registration_generalized_icp(*arguments, estimation, criteria)
        return found.transformation
    if metric == "plane":
        if not target.has_normals():
            target.estimate_normals(nearest(neighbors))
        estimation = registration.TransformationEstimationPointToPlane()
    else:
        estimation = registration.TransformationEstimationPointToPoint()
    return registration.registration_icp(*arguments, estimation, criteria).transformation


def evaluated(source, target, max_distance, pose):
    """Its evaluation of a pose of arrays: `fitness` and `inlier_rmse`."""
    registration = import_open3d().pipelines.registration
    return registration.evaluate_registration(cloud(source), cloud(target), max_distance, pose)


if __name__ == "__main__":
    print(f"open3d {import_open3d().__version__} loads")
