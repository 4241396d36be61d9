"""The ICP reference beside Open3D: step by step where both take the same one, and at rest."""

import unittest

import numpy as np

from reference.icp import icp
from reference.normals import normals
from surfaces import random_rotation, relief

METRICS = ("point", "plane", "generalized")
BOUND = 0.5
"""Longest pair."""


class Icp(unittest.TestCase):
    def setUp(self):
        # Not all clouds have a rest: under others two sets of pairs lead to each other.
        rng = np.random.default_rng(7)
        self.source = relief(250, rng)
        self.turn = random_rotation(rng, degrees=8.0)
        self.target = relief(300, rng) @ self.turn.T + [0.05, 0.0, -0.05]

    def open3d(self, metric, iterations):
        try:
            from system_libraries import import_open3d

            o3d = import_open3d()
        except ImportError:
            self.skipTest("open3d is not installed")
        registration = o3d.pipelines.registration
        clouds = [
            o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
            for points in (self.source, self.target)
        ]
        for cloud, points in zip(clouds, (self.source, self.target)):
            cloud.normals = o3d.utility.Vector3dVector(normals(points, 20)[0])
        criteria = registration.ICPConvergenceCriteria(0.0, 0.0, iterations)
        arguments = *clouds, BOUND, np.eye(4)
        if metric == "generalized":
            # From the clouds' normals: discs of thickness 1e-3.
            return registration.registration_generalized_icp(
                *arguments, criteria=criteria
            ).transformation
        estimation = {
            "point": registration.TransformationEstimationPointToPoint,
            "plane": registration.TransformationEstimationPointToPlane,
        }[metric]()
        return registration.registration_icp(*arguments, estimation, criteria).transformation

    def test_open3d_takes_the_same_point_to_point_steps(self):
        steps = icp(self.source, self.target, max_distance=BOUND, max_iterations=6)
        for number, step in enumerate(steps, 1):
            theirs = self.open3d("point", number)
            np.testing.assert_allclose(step.rotation, theirs[:3, :3], atol=1e-9)
            np.testing.assert_allclose(step.translation, theirs[:3, 3], atol=1e-9)

    def test_open3d_comes_to_the_same_rest(self):
        for metric in METRICS:
            last = icp(self.source, self.target, metric, max_distance=BOUND, max_iterations=40)[-1]
            theirs = self.open3d(metric, 80)
            np.testing.assert_allclose(last.rotation, theirs[:3, :3], atol=1e-9)
            np.testing.assert_allclose(last.translation, theirs[:3, 3], atol=1e-9)

    def test_a_moved_copy_is_found(self):
        for metric in METRICS:
            last = icp(self.source, self.source @ self.turn.T, metric, max_iterations=60)[-1]
            np.testing.assert_allclose(last.rotation, self.turn, atol=1e-9)


if __name__ == "__main__":
    unittest.main()
