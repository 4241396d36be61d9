"""The SC2-PCR reference: its measure by counting, and problems whose answer is known."""

import unittest

import numpy as np

from reference.sc2pcr import consensus, inliers, sc2pcr, second_order, seeds, weighted_pose
from reference.rotations import random_rotation


class SecondOrder(unittest.TestCase):
    def setUp(self):
        self.rng = np.random.default_rng(8)

    def matches(self, count, wrong, noise=0.0):
        """A moved copy of `count` points, the first `wrong` of them shuffled."""
        turn, shift = random_rotation(self.rng), np.array([1.0, -2.0, 3.0])
        source = self.rng.uniform(-1, 1, (count, 3))
        target = source @ turn.T + shift + noise * self.rng.normal(size=(count, 3))
        target[:wrong] = np.roll(target[:wrong], 1, axis=0)
        truth = np.eye(4)
        truth[:3, :3], truth[:3, 3] = turn, shift
        return source, target, truth

    def test_a_moved_copy_is_found_among_nine_wrong_in_ten(self):
        source, target, truth = self.matches(200, 180)
        np.testing.assert_allclose(sc2pcr(source, target, 0.05), truth, atol=1e-12)

    def test_noise_is_averaged_over_the_right_matches(self):
        source, target, truth = self.matches(200, 120, noise=0.01)
        found = sc2pcr(source, target, 0.05)
        # For 80 points about a unit cube: 0.01 / sqrt(80), with room.
        np.testing.assert_allclose(found, truth, atol=0.006)
        within = inliers(found, source, target, 0.05)
        self.assertGreaterEqual(within.sum(), 80)
        again = weighted_pose(within.astype(float), source, target)
        np.testing.assert_allclose(found, again, atol=1e-12)

    def test_the_answer_goes_along_with_the_clouds(self):
        source, target, _ = self.matches(120, 90, noise=0.01)
        turn = random_rotation(self.rng)
        found = sc2pcr(source, target, 0.05)
        moved = sc2pcr(source, target @ turn.T, 0.05)
        np.testing.assert_allclose(moved[:3, :3], turn @ found[:3, :3], atol=1e-9)
        np.testing.assert_allclose(moved[:3, 3], turn @ found[:3, 3], atol=1e-9)

    def test_matches_on_a_line_have_no_pose(self):
        source = np.outer(np.arange(40.0), [1.0, 0.0, 0.0])
        self.assertIsNone(sc2pcr(source, source, 0.1))

    def test_seeds_are_peaks_in_order(self):
        line = np.arange(10.0)
        distance = np.abs(line[:, None] - line)
        confidence = np.array([1, 3, 2, 5, 4, 0, 0.5, 9, 8, 7])
        # Peaks within 1.5 are 7, 3 and 1; a fifth of ten matches is two.
        self.assertEqual(seeds(confidence, distance, 1.5).tolist(), [7, 3])

    def test_the_second_order_counts_common_neighbours(self):
        # A triangle 0 1 2, and 3 joined to 2 alone.
        hard = np.eye(4)
        for i, j in ((0, 1), (1, 2), (0, 2), (2, 3)):
            hard[i, j] = hard[j, i] = 1
        # Each is joined to itself, so two that are joined share themselves too.
        expected = [[3, 3, 3, 0], [3, 3, 3, 0], [3, 3, 4, 2], [0, 0, 2, 2]]
        np.testing.assert_array_equal(second_order(hard), expected)

    def test_the_second_stage_counts_among_the_first(self):
        hard = (self.rng.random((60, 60)) < 0.4).astype(float)
        hard = np.maximum(np.maximum(hard, hard.T), np.eye(60))
        order = [[hard[i, j] * sum(hard[i] * hard[j]) for j in range(60)] for i in range(60)]
        near = sorted(range(60), key=lambda j: -order[5][j])[:30]
        among = lambda j: hard[5, j] * sum(hard[5, k] * hard[j, k] for k in near)
        self.assertEqual(
            consensus(hard, np.array(order), 5).tolist(), sorted(near, key=lambda j: -among(j))[:20]
        )


if __name__ == "__main__":
    unittest.main()
