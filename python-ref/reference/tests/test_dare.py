"""The DARE reference against what its paper promises."""

import unittest

import numpy as np

from reference.dare import axes, dare, golden_sphere, observation_weights
from reference.rotations import random_rotation
from reference.surfaces import relief


class Dare(unittest.TestCase):
    def setUp(self):
        rng = np.random.default_rng(3)
        self.source = relief(200, rng)
        self.turn = random_rotation(rng, degrees=15.0)
        self.target = self.source @ self.turn.T + [0.1, 0.0, -0.1]

    def test_a_moved_copy_is_found(self):
        for neighbors in (0, 10):
            last = dare(self.source, self.target, 30, density_neighbors=neighbors, iterations=150)[-1]
            np.testing.assert_allclose(last.pose.rotation, self.turn, atol=2e-3)
            moved = self.source @ last.pose.rotation.T + last.pose.translation
            np.testing.assert_allclose(moved, self.target, atol=4e-3)

    def test_the_likelihood_never_falls(self):
        rng = np.random.default_rng(4)
        for ratio in (1e-3, 0.3):
            steps = dare(self.source, relief(150, rng) @ self.turn.T, 25, ratio, iterations=60)
            gains = np.diff([step.log_likelihood for step in steps])
            self.assertGreaterEqual(gains.min(), -1e-12)

    def test_a_point_weighs_as_much_as_the_surface_it_stands_for(self):
        fine = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), -1).reshape(-1, 3)
        weights = observation_weights(np.vstack([fine, 2 * fine + [100.0, 0, 0]]), 9)
        self.assertAlmostEqual(weights.sum(), 1.0)
        self.assertAlmostEqual(weights[400 + 210] / weights[210], 4.0)

    def test_the_start_turns_with_the_target(self):
        moved = axes(self.source @ self.turn.T)
        np.testing.assert_allclose(moved, axes(self.source) @ self.turn.T, atol=1e-12)
        self.assertAlmostEqual(np.linalg.det(moved), 1.0)
        np.testing.assert_allclose(np.linalg.norm(golden_sphere(50), axis=1), 1.0)


if __name__ == "__main__":
    unittest.main()
