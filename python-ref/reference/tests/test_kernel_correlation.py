"""The kernel correlation reference: what it promises, and that its end is a maximum."""

import itertools
import unittest

import numpy as np

from reference.kernel_correlation import correlation, schedule, steps
from reference.pose import Pose
from reference.rotations import from_quaternion, random_rotation
from reference.surfaces import relief


class KernelCorrelation(unittest.TestCase):
    def setUp(self):
        rng = np.random.default_rng(5)
        self.rng = rng
        self.source = relief(150, rng)
        self.turn = random_rotation(rng, degrees=15.0)
        self.target = relief(120, rng) @ self.turn.T + [0.1, 0.0, -0.1]
        self.start = Pose(1.0, np.eye(3), np.zeros(3))

    def test_it_never_falls_at_one_sigma(self):
        found = steps(self.source, self.target, self.start, [0.6, 0.3, 0.1], 0.0, 40)
        for one, after in itertools.pairwise(found):
            if one.sigma == after.sigma:
                self.assertGreaterEqual(after.correlation, one.correlation * (1 - 1e-14))

    def test_it_is_the_correlation_at_the_pose_before(self):
        found = steps(self.source, self.target, self.start, [0.3], 0.0, 5)
        for one, after in itertools.pairwise(found):
            want = correlation(self.source, self.target, one.pose, 0.3)
            self.assertAlmostEqual(after.correlation, want, delta=1e-9 * want)

    def test_the_end_is_a_maximum(self):
        pose = steps(self.source, self.target, self.start, [0.5, 0.3], 0.0, 3000)[-1].pose
        best = correlation(self.source, self.target, pose, 0.3)
        for _ in range(20):
            nudge = from_quaternion(np.append(1.0, 1e-3 * self.rng.normal(size=3)))
            shift = 1e-3 * self.rng.normal(size=3)
            other = Pose(1.0, nudge @ pose.rotation, pose.translation + shift)
            self.assertLess(correlation(self.source, self.target, other, 0.3), best)

    def test_a_moved_copy_is_found(self):
        target = self.source @ self.turn.T + [0.1, 0.0, -0.1]
        pose = steps(self.source, target, self.start, schedule(0.5, 0.01, 0.7), 1e-9, 200)[-1].pose
        np.testing.assert_allclose(pose.rotation, self.turn, atol=1e-6)
        np.testing.assert_allclose(pose.translation, [0.1, 0.0, -0.1], atol=1e-6)


if __name__ == "__main__":
    unittest.main()
