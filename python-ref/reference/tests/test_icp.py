"""The ICP reference beside Open3D: step by step where both take the same one, and at rest."""

import unittest

import numpy as np

from peers.programs import is_installed, open3d
from reference.icp import icp
from reference.normals import normals
from reference.rotations import random_rotation
from reference.surfaces import relief

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
        if not is_installed("open3d"):
            self.skipTest("open3d is not installed")
        clouds = [open3d.cloud(c, normals(c, 20)[0]) for c in (self.source, self.target)]
        return open3d.iterative_closest_point(metric, *clouds, BOUND, tolerance=0.0, max_iterations=iterations)

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
