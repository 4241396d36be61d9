"""The CF-spectral reference: its parts by hand, and a moved copy among wrong connections."""

import unittest

import numpy as np

from reference import moments, solve
from reference.rotations import random_rotation
from reference.spectral import Rule, first_order, second_order, spectral_weights, strongest

ANY_NORMAL = Rule(normal_tolerance=2.0)


class Spectral(unittest.TestCase):
    def setUp(self):
        self.rng = np.random.default_rng(4)

    def test_the_strongest_are_the_largest_in_order(self):
        weights = np.array([[0.2, 0.9, 0.0], [0.5, 0.2, 0.7]])
        source, target = strongest(weights, 4)
        self.assertEqual((source.tolist(), target.tolist()), ([0, 1, 1, 0], [1, 2, 0, 0]))
        # Weights of nothing are no connections.
        self.assertEqual(len(strongest(weights, 6)[0]), 5)

    def test_compatible_are_those_that_keep_length_and_angle(self):
        source = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [1, 0, 0]])
        target = source + [[0, 0, 0], [1.4, 0, 0], [0, 1.6, 0], [0, 0, 0]]
        up = np.tile([0.0, 0, 1], (4, 1))
        compatible = first_order((source, up), (target, up), 1.0)
        self.assertEqual(compatible[0].tolist(), [0, 1, 0, 0])
        turned = up.copy()
        turned[1] = [0.0, np.sin(1.2), np.cos(1.2)]
        self.assertEqual(first_order((source, up), (target, turned), 1.0)[0, 1], 0)
        self.assertEqual(first_order((source, up), (target, turned), 1.0, ANY_NORMAL)[0, 1], 1)

    def test_second_order_counts_common_neighbours(self):
        square = np.array([[0, 1, 1, 0], [1, 0, 1, 1], [1, 1, 0, 0], [0, 1, 0, 0]], dtype=float)
        counted = [[0, 1, 1, 0], [1, 0, 1, 0], [1, 1, 0, 0], [0, 0, 0, 0]]
        self.assertEqual(second_order(square).tolist(), counted)

    def test_one_solve_finds_a_moved_copy_among_nine_wrong_in_ten(self):
        turn, shift = random_rotation(self.rng), np.array([1.0, -2.0, 3.0])
        source = self.rng.uniform(-50, 50, (300, 3))
        target = source @ turn.T + shift + self.rng.uniform(-0.3, 0.3, (300, 3))
        target[30:] = self.rng.uniform(-50, 50, (270, 3))
        normals = np.zeros((300, 3))
        compatible = first_order((source, normals), (target, normals), 1.0, ANY_NORMAL)
        weights, (first, second) = spectral_weights(second_order(compatible))
        self.assertGreater(weights[:30].sum(), 0.99 * weights.sum())
        self.assertGreater(first, 3.0 * second)
        pose = solve(moments(np.diag(weights), source, target))
        np.testing.assert_allclose(pose.rotation, turn, atol=0.01)


if __name__ == "__main__":
    unittest.main()
