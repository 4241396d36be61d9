"""The peers, each with the settings its authors recommend, in units of the clouds' spacing.

The recommendations are multiples of the voxel that clouds are thinned by. 500 points need
no thinning; their spacing (`Pair.spacing`) is what a voxel would leave, and stands for it.
Nothing was tuned to the trials. On one processor (`__main__`) each gives the same again:
Open3D's two take a seed, KISS-Matcher takes none and was found to do so too. On more,
RANSAC does not.

Features come from Open3D, whose normals look at the viewpoint that a pair names. KISS-Matcher
makes its own, which look at the origin, so it gets the clouds moved to where their viewpoint
is the origin. It refuses voxels below 5 mm.
"""

import importlib.util
from dataclasses import dataclass
from importlib.metadata import version
from typing import Callable

import numpy as np

from reference.sc2pcr import sc2pcr
from scans import import_open3d


@dataclass(frozen=True)
class Contender:
    name: str
    package: str
    """Whose version is told, and without which it is left out."""
    settings: dict
    """Lengths are in units of the spacing."""
    align: Callable
    """Of a pair and the settings to the pose (4, 4), or None."""

    def word(self):
        """In names of files."""
        return self.name.lower().split()[0]

    def title(self):
        return f"{self.name}, {self.package} {version(self.package)}"


def installed():
    """The contenders whose package is there; a line names one that is not."""
    for contender in CONTENDERS:
        if importlib.util.find_spec(contender.package.replace("-", "_")) is None:
            print(f"left out: {contender.name}, {contender.package} is not installed")
        else:
            yield contender


FEATURES = {"normal_radius": 2.0, "normal_most": 30, "fpfh_radius": 5.0, "fpfh_most": 100}
"""Open3D's tutorial on global registration."""


def features(pair, normal_radius, normal_most, fpfh_radius, fpfh_most):
    """Clouds and FPFH of both sides, as Open3D has them."""
    o3d = import_open3d()
    within, unit = o3d.geometry.KDTreeSearchParamHybrid, pair.spacing()
    clouds = []
    for points, viewpoint in zip((pair.source, pair.target), pair.viewpoints):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        cloud.estimate_normals(within(normal_radius * unit, normal_most))
        cloud.orient_normals_towards_camera_location(viewpoint)
        clouds.append(cloud)
    search = within(fpfh_radius * unit, fpfh_most)
    return clouds, [o3d.pipelines.registration.compute_fpfh_feature(c, search) for c in clouds]


def ransac(pair, distance, edge_length, iterations, confidence, seed, **of_features):
    o3d = import_open3d()
    registration = o3d.pipelines.registration
    clouds, described = features(pair, **of_features)
    o3d.utility.random.seed(seed)
    longest = distance * pair.spacing()
    return registration.registration_ransac_based_on_feature_matching(
        *clouds,
        *described,
        mutual_filter=True,
        max_correspondence_distance=longest,
        checkers=[
            registration.CorrespondenceCheckerBasedOnEdgeLength(edge_length),
            registration.CorrespondenceCheckerBasedOnDistance(longest),
        ],
        criteria=registration.RANSACConvergenceCriteria(iterations, confidence),
    ).transformation


def fast_global(pair, distance, seed, **of_features):
    o3d = import_open3d()
    registration = o3d.pipelines.registration
    clouds, described = features(pair, **of_features)
    o3d.utility.random.seed(seed)
    option = registration.FastGlobalRegistrationOption(
        maximum_correspondence_distance=distance * pair.spacing()
    )
    found = registration.registration_fgr_based_on_feature_matching(*clouds, *described, option)
    return found.transformation


def second_order(pair, threshold, **of_features):
    """Matches are each source point and the target point of the nearest descriptor."""
    _, (source, target) = features(pair, **of_features)
    matches = import_open3d().pipelines.registration.correspondences_from_features(
        source, target, mutual_filter=False
    )
    i, j = np.asarray(matches).T
    return sc2pcr(pair.source[i], pair.target[j], threshold * pair.spacing())


def kiss_matcher(pair, voxel):
    import kiss_matcher

    config = kiss_matcher.KISSMatcherConfig(
        voxel_size=voxel * pair.spacing(), use_voxel_sampling=False
    )
    seen = zip((pair.source, pair.target), pair.viewpoints)
    clouds = [list((points - viewpoint).astype(np.float32)) for points, viewpoint in seen]
    found = kiss_matcher.KISSMatcher(config).estimate(*clouds)
    if not found.valid:
        return None
    pose = np.eye(4)
    pose[:3, :3] = found.rotation
    source, target = pair.viewpoints
    pose[:3, 3] = np.ravel(found.translation) + target - pose[:3, :3] @ source
    return pose


CONTENDERS = (
    Contender("KISS-Matcher", "kiss-matcher", {"voxel": 1.0}, kiss_matcher),
    Contender(
        "RANSAC on FPFH",
        "open3d",
        # The tutorial's, its seed fixed.
        {"distance": 1.5, "edge_length": 0.9, "iterations": 100_000, "confidence": 0.999, "seed": 0}
        | FEATURES,
        ransac,
    ),
    Contender("FGR", "open3d", {"distance": 0.5, "seed": 0} | FEATURES, fast_global),
    # Two voxels, as the authors take for FPFH indoors.
    Contender(
        "SC2-PCR from its paper on FPFH", "open3d", {"threshold": 2.0} | FEATURES, second_order
    ),
)
