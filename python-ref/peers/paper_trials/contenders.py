"""The peers, each with the settings its authors recommend, in units of the clouds' spacing.

The recommendations are multiples of the voxel that clouds are downsampled by. 500 points need
no downsampling; their spacing (`TrialPair.spacing`) is what a voxel would leave, and stands for it.
Nothing was tuned to the trials. On one processor (`__main__`) each gives the same again:
Open3D's two take a seed, KISS-Matcher takes none and was found to do so too. On more,
RANSAC does not.

Features come from Open3D, whose normals look at the viewpoint that a pair names. KISS-Matcher
makes its own, which look at the origin, so it gets the clouds moved to where their viewpoint
is the origin. It refuses voxels below 5 mm.
"""

from dataclasses import dataclass
from importlib.metadata import version
from typing import Callable

from peers.programs import is_installed, kiss_matcher, open3d
from reference.sc2pcr import sc2pcr


@dataclass(frozen=True)
class Contender:
    name: str
    package: str
    """Whose version is told, and without which it is left out."""
    settings: dict
    """Lengths are in units of the spacing."""
    align: Callable
    """From a pair and the settings to the pose (4, 4), or None."""

    def file_name(self):
        """As files of its trials are called."""
        return self.name.lower().split()[0]

    def title(self):
        return f"{self.name}, {self.package} {version(self.package)}"


def installed():
    """The contenders whose package is there; a line names one that is not."""
    for contender in CONTENDERS:
        if not is_installed(contender.package):
            print(f"left out: {contender.name}, {contender.package} is not installed")
        else:
            yield contender


FEATURES = {"normal_radius": 2.0, "normal_most": 30, "fpfh_radius": 5.0, "fpfh_most": 100}
"""Open3D's tutorial on global registration."""


def feature_clouds(pair, normal_radius, normal_most, fpfh_radius, fpfh_most):
    """Clouds with FPFH of both sides, as Open3D has them."""
    unit = pair.spacing()
    sizes = normal_radius * unit, normal_most, fpfh_radius * unit, fpfh_most
    sides = zip((pair.source, pair.target), pair.viewpoints)
    return [open3d.feature_cloud(points, viewpoint, *sizes) for points, viewpoint in sides]


def ransac(pair, distance, edge_length, iterations, confidence, seed, **features):
    clouds = feature_clouds(pair, **features)
    open3d.seed(seed)
    return open3d.ransac(*clouds, distance * pair.spacing(), edge_length, iterations, confidence)


def fast_global(pair, distance, seed, **features):
    clouds = feature_clouds(pair, **features)
    open3d.seed(seed)
    return open3d.fast_global(*clouds, distance * pair.spacing())


def second_order(pair, threshold, **features):
    """Matches are each source point and the target point of the nearest descriptor."""
    i, j = open3d.matches(*feature_clouds(pair, **features)).T
    return sc2pcr(pair.source[i], pair.target[j], threshold * pair.spacing())


def by_kiss_matcher(pair, voxel):
    source, target = pair.viewpoints
    clouds = pair.source - source, pair.target - target
    pose, valid = kiss_matcher.register(*clouds, voxel * pair.spacing(), downsample=False)
    if not valid:
        return None
    pose[:3, 3] += target - pose[:3, :3] @ source
    return pose


CONTENDERS = (
    Contender("KISS-Matcher", "kiss-matcher", {"voxel": 1.0}, by_kiss_matcher),
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
