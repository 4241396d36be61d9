"""Loops of poses whose errors are drawn from known covariances."""

import unittest

import numpy as np
from scipy.spatial.transform import Rotation

from peers.loops import about_zero, loop_nees, loops, nees, twist_from


def motion(vector):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(vector[:3]).as_matrix()
    pose[:3, 3] = vector[3:]
    return pose


def about(center, vector):
    """The motion of a turn about `center`, then a shift."""
    pose = motion(vector)
    pose[:3, 3] += center - pose[:3, :3] @ center
    return pose


class Loops(unittest.TestCase):
    def setUp(self):
        self.rng = np.random.default_rng(3)

    def covariance(self):
        root = self.rng.normal(size=(6, 6)) * np.array([1, 1, 1, 5, 5, 5])[:, None] * 1e-4
        return root @ root.T

    def found(self, truth, covariance, center):
        """A pose off by a draw of `covariance`, with it about the zero."""
        error = self.rng.multivariate_normal(np.zeros(6), covariance)
        return np.linalg.inv(about(center, error)) @ truth, about_zero(covariance, center)

    def test_six_in_the_mean(self):
        onto_b, onto_c = (motion(self.rng.normal(size=6) * [1, 1, 1, 9, 9, 9]) for _ in range(2))
        truths = [onto_b, onto_c, onto_c @ onto_b]
        covariances = [self.covariance() for _ in truths]
        centers = self.rng.normal(size=(3, 3)) * 20
        closed, single = [], []
        for _ in range(2000):
            poses = [self.found(*three) for three in zip(truths, covariances, centers)]
            closed.append(loop_nees(*poses))
            single.append(nees(twist_from(truths[0] @ np.linalg.inv(poses[0][0])), poses[0][1]))
        # The mean of 2000 has a standard deviation of 0.08.
        self.assertAlmostEqual(np.mean(closed), 6, delta=0.4)
        self.assertAlmostEqual(np.mean(single), 6, delta=0.4)

    def test_loops_are_those_with_all_three_pairs(self):
        pairs = dict.fromkeys([("a", "b"), ("b", "c"), ("a", "c"), ("c", "d")])
        self.assertEqual(loops(pairs, 9), [("a", "b", "c")])


if __name__ == "__main__":
    unittest.main()
