"""The CPD reference beside pycpd, which holds N x M matrices and always estimates scale."""

import unittest

import numpy as np

from peers.programs import is_installed, pycpd
from reference.cpd import cpd
from reference.rotations import random_rotation
from reference.surfaces import relief


class Cpd(unittest.TestCase):
    def setUp(self):
        rng = np.random.default_rng(3)
        self.source = relief(200, rng)
        self.turn = random_rotation(rng, degrees=15.0)
        self.target = relief(180, rng) @ self.turn.T + [0.1, 0.0, -0.1]

    def test_pycpd_finds_the_same(self):
        if not is_installed("pycpd"):
            self.skipTest("pycpd is not installed")
        for w in (0.0, 0.1):
            scale, rotation, translation = pycpd.register(self.source, self.target, w, 40, 0.0)
            pose, _ = cpd(self.source, self.target, w, "umeyama", 40)
            self.assertAlmostEqual(pose.scale, scale, delta=1e-9)
            np.testing.assert_allclose(pose.rotation, rotation, atol=1e-9)
            np.testing.assert_allclose(pose.translation, translation, atol=1e-9)

    def test_a_moved_copy_is_found(self):
        pose, sigma = cpd(self.source, self.source @ self.turn.T, 0.1, "fixed", 60)
        np.testing.assert_allclose(pose.rotation, self.turn, atol=1e-6)
        self.assertLess(sigma, 1e-3)


if __name__ == "__main__":
    unittest.main()
