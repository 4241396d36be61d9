"""PCL's global registration: a pose is found, and none is told where too little would meet."""

import unittest

import numpy as np

from peers.programs import pcl
from reference.rotations import random_rotation
from reference.surfaces import VIEWPOINT, relief

VOXEL = 0.1


@unittest.skipIf(pcl.program("prerejective") is None, "libpcl-dev, cmake or g++ is not installed")
class Prerejective(unittest.TestCase):
    def setUp(self):
        rng = np.random.default_rng(1)
        self.target = relief(4000, rng)
        self.turn, self.shift = random_rotation(rng), np.array([1.0, -2.0, 0.5])
        self.source = (relief(4000, rng) - self.shift) @ self.turn
        self.sensors = [(VIEWPOINT - self.shift) @ self.turn, VIEWPOINT]

    def align(self, target):
        return pcl.prerejective(self.source, target, self.sensors, VOXEL)

    def test_the_pose_is_found_and_found_again(self):
        pose, seconds = self.align(self.target)
        self.assertIsNotNone(pose)
        self.assertGreater(seconds, 0)
        moved, truth = (self.source @ r.T + t for r, t in ((pose[:3, :3], pose[:3, 3]), (self.turn, self.shift)))
        self.assertLess(np.linalg.norm(moved - truth, axis=1).mean(), VOXEL)
        np.testing.assert_array_equal(self.align(self.target)[0], pose)

    def test_a_corner_on_which_no_quarter_of_the_source_fits_has_no_pose(self):
        corner = self.target[(self.target[:, :2] < [-0.7, -0.4]).all(axis=1)]
        pose, _ = self.align(corner)
        self.assertIsNone(pose)


if __name__ == "__main__":
    unittest.main()
