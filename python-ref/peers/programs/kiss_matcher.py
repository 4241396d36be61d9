"""KISS-Matcher: global registration, and the time of its features."""

import numpy as np

from peers.programs import pose_from


def register(source, target, voxel, downsample=True):
    """Pose and whether it calls it valid. It refuses voxels below 5 mm."""
    import kiss_matcher

    config = kiss_matcher.KISSMatcherConfig(voxel_size=voxel, use_voxel_sampling=downsample)
    found = kiss_matcher.KISSMatcher(config).estimate(rows(source), rows(target))
    return pose_from(found.rotation, found.translation), bool(found.valid)


def extraction(points, radius, normal_share):
    """Seconds that the features of a cloud take, and how many points it describes; normals are of
    that share of the radius."""
    import kiss_matcher

    config = kiss_matcher.KISSMatcherConfig(
        voxel_size=radius,
        use_voxel_sampling=False,
        normal_r_gain=normal_share,
        fpfh_r_gain=1.0,
    )
    matcher = kiss_matcher.KISSMatcher(config)
    # It matches pairs alone: the other side is a hundred points.
    matcher.match(list(points), list(points[:100]))
    return matcher.get_extraction_time(), len(matcher.get_keypoints_from_faster_pfh()[0])


def rows(points):
    return list(np.asarray(points, dtype=np.float32))
