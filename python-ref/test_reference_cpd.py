"""The CPD reference beside pycpd, which holds N x M matrices and always estimates scale."""

import unittest

import numpy as np

from reference.cpd import cpd
from surfaces import random_rotation, relief


class Cpd(unittest.TestCase):
    def setUp(self):
        rng = np.random.default_rng(3)
        self.source = relief(200, rng)
        self.turn = random_rotation(rng, degrees=15.0)
        self.target = relief(180, rng) @ self.turn.T + [0.1, 0.0, -0.1]

    def test_pycpd_finds_the_same(self):
        try:
            from pycpd import RigidRegistration
        except ImportError:
            self.skipTest("pycpd is not installed")
        for w in (0.0, 0.1):
            peer = RigidRegistration(
                X=self.target, Y=self.source, w=w, max_iterations=40, tolerance=0.0
            )
            _, (scale, rotation, translation) = peer.register()
            pose, _ = cpd(self.source, self.target, w, "umeyama", 40)
            self.assertAlmostEqual(pose.scale, scale, delta=1e-9)
            np.testing.assert_allclose(pose.rotation, rotation.T, atol=1e-9)
            np.testing.assert_allclose(pose.translation, np.ravel(translation), atol=1e-9)

    def test_a_moved_copy_is_found(self):
        pose, sigma = cpd(self.source, self.source @ self.turn.T, 0.1, "fixed", 60)
        np.testing.assert_allclose(pose.rotation, self.turn, atol=1e-6)
        self.assertLess(sigma, 1e-3)


if __name__ == "__main__":
    unittest.main()
