"""The keypoints of the reference on surfaces whose answer is known."""

import unittest

import numpy as np

from reference.keypoints import extrema, iss, sift, sift_octaves, spreads, downsampled
from reference.rotations import random_rotation
from reference.surfaces import relief


def grid(side=24):
    """A flat square of points, a little off their grid so that no two distances tie."""
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    flat = np.stack([x.ravel(), y.ravel(), np.zeros(side * side)], axis=1).astype(float)
    return flat + rng.uniform(-0.1, 0.1, flat.shape) * [1, 1, 0]


class Sift(unittest.TestCase):
    def test_a_blob_is_found_at_its_centre_and_at_its_scale(self):
        points = grid()
        values = np.exp(-((points - [12.0, 11.0, 0.0]) ** 2).sum(axis=1) / (2 * 2.0**2))
        found = sift(points, values, 1.0, min_contrast=0.02)
        self.assertTrue(len(found))
        self.assertLess(np.linalg.norm(points[found] - [12, 11, 0], axis=1).min(), 1.5)
        self.assertEqual(len(sift(points, values, 1.0, min_contrast=1.0)), 0)

    def test_cubes_hold_the_mean_and_are_those_of_the_corner(self):
        points = np.array([[0.0, 0, 0], [0.5, 0.5, 0], [1.5, 0, 0]])
        means, values = downsampled(points, [1.0, 3.0, 5.0], 1.0, np.zeros(3))
        np.testing.assert_allclose(means, [[0.25, 0.25, 0], [1.5, 0, 0]])
        np.testing.assert_allclose(values, [2.0, 5.0])
        self.assertEqual(len(downsampled(points, [1.0, 3.0, 5.0], 1.0, np.array([-0.5, -0.5, 0.0]))[0]), 3)

    def test_a_shift_changes_nothing_unless_the_corner_stays(self):
        points = np.round(relief(400, np.random.default_rng(3)) * 2.0**16) / 2.0**16
        values = points[:, 2]
        moved = points + [3.0, -2.0, 1.0]
        wanted = sift(points, values, 0.05)
        np.testing.assert_array_equal(sift(moved, values, 0.05), wanted)
        origin = sift(moved + 0.03125, values, 0.05, corner=np.zeros(3))
        self.assertFalse(np.array_equal(origin, wanted))

    def test_no_extremum_in_a_constant(self):
        points = grid()
        # Sums of a constant differ in their last bits.
        for thin, _, keys in sift_octaves(points, np.ones(len(points)), 1.0, min_contrast=1e-12):
            self.assertEqual(len(keys), 0, len(thin))

    def test_an_extremum_is_strict_beside_its_scale(self):
        points = grid(8)
        differences = np.zeros((len(points), 3))
        differences[27, 1] = 1.0
        self.assertEqual(extrema(points, differences, 0.0).tolist(), [27])
        differences[27, 2] = 1.0
        self.assertEqual(extrema(points, differences, 0.0).tolist(), [])


class Iss(unittest.TestCase):
    def test_eigenvalues_are_those_of_the_covariance(self):
        points = relief(300, np.random.default_rng(0))
        values = spreads(points, 0.3, 5)
        inside = points[np.linalg.norm(points - points[7], axis=1) <= 0.3]
        self.assertAlmostEqual(values[7].sum(), inside.var(axis=0).sum(), places=12)

    def test_a_rotation_changes_nothing(self):
        rng = np.random.default_rng(5)
        points = relief(400, rng)
        wanted = iss(points, 0.3, 0.2)
        self.assertTrue(len(wanted) > 5)
        np.testing.assert_array_equal(iss(points @ random_rotation(rng).T, 0.3, 0.2), wanted)

    def test_a_plane_has_none(self):
        self.assertEqual(len(iss(grid(), 4.0, 2.0)), 0)


if __name__ == "__main__":
    unittest.main()
