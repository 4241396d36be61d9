"""Moments of the full connection, and the closed forms."""

import pickle
import unittest

import cfreg
import numpy as np
from shapes import terrain, turned


class Moments(unittest.TestCase):
    def setUp(self):
        self.points = terrain(300)
        self.moved, self.truth = turned(self.points)
        self.descriptors = np.random.default_rng(5).normal(size=(300, 8))
        self.moments = self.weigh(beta=1e-2)

    def weigh(self, **settings):
        return cfreg.moments(self.points, self.moved, self.descriptors, self.descriptors, **settings)

    def test_sums_are_those_of_the_formula(self):
        d2 = ((self.descriptors[:, None] - self.descriptors[None]) ** 2).sum(axis=2)
        found = self.weigh(weights="cauchy", beta=4.0)
        w = 1.0 / (1.0 + d2 / 4.0)
        p, q = self.points - found.source_origin, self.moved - found.target_origin
        for name, value in {
            "weight": w.sum(),
            "weight_squared": (w**2).sum(),
            "source_sum": w.sum(axis=1) @ p,
            "target_sum": w.sum(axis=0) @ q,
            "cross": p.T @ w @ q,
            "source_squares": w.sum(axis=1) @ (p**2).sum(axis=1),
            "target_squares": w.sum(axis=0) @ (q**2).sum(axis=1),
            "effective_connections": w.sum() ** 2 / (w**2).sum(),
        }.items():
            with self.subTest(name):
                # Weights are f32, and sums of one sign cancel against each other.
                np.testing.assert_allclose(getattr(found, name), value, rtol=1e-5, atol=1e-6 * w.sum())

    def test_attributes_are_read_only(self):
        with self.assertRaises(AttributeError):
            self.moments.weight = 1.0
        with self.assertRaises(ValueError):
            self.moments.cross[0, 0] = 1.0
        self.assertEqual(self.moments.cross.shape, (3, 3))
        for name in ("source_sum", "target_sum", "source_origin", "target_origin"):
            self.assertFalse(getattr(self.moments, name).flags.writeable)

    def test_pickles_are_the_same_bits(self):
        again = pickle.loads(pickle.dumps(self.moments))
        self.assertEqual(again, self.moments)
        np.testing.assert_array_equal(again.cross, self.moments.cross)
        self.assertNotEqual(self.weigh(beta=2.0), self.moments)

    def test_every_solver_finds_the_pose_and_its_residual(self):
        for solver in ("arun", "horn-quaternion", "horn-matrix", "walker"):
            found = cfreg.solve(self.moments, solver=solver)
            self.assertEqual((found.shape, found.dtype), ((4, 4), np.float64))
            np.testing.assert_allclose(found, self.truth, atol=1e-5)
        self.assertLess(self.moments.residual(self.truth), 1e-6 * self.moments.weight)
        self.assertGreater(self.moments.residual(np.eye(4)), 0.1 * self.moments.weight)
        with self.assertRaisesRegex(ValueError, "^transform"):
            self.moments.residual(2.0 * np.eye(4))

    def test_scale_is_estimated_where_asked(self):
        half = cfreg.moments(
            self.points, 0.5 * self.moved, self.descriptors, self.descriptors, beta=1e-2
        )
        for scale in ("umeyama", "symmetric"):
            linear = cfreg.solve(half, scale=scale)[:3, :3]
            np.testing.assert_allclose(np.cbrt(np.linalg.det(linear)), 0.5, rtol=1e-4)

    def test_arguments_are_refused_by_name(self):
        p, d = self.points, self.descriptors
        hole = d.copy()
        hole[3, 2] = np.nan
        huge = np.full_like(d, 1e300)
        for argument, call in {
            "source_points": lambda: cfreg.moments(np.full_like(p, np.inf), p, d, d),
            "target_points": lambda: cfreg.moments(p, p * 1e20, d, d),
            "source_descriptors.* row 3": lambda: cfreg.moments(p, p, hole, d),
            "target_descriptors = 1e300: must be within": lambda: cfreg.moments(p, p, d, huge),
            r"beta = \[5\]: must be a number": lambda: self.weigh(beta=[5]),
            "target_descriptors.*300.*299": lambda: cfreg.moments(p, p, d, d[1:]),
            "source_descriptors: ": lambda: cfreg.moments(p, p, d[:, :0], d),
            "columns of target_descriptors": lambda: cfreg.moments(p, p, d, d[:, 1:]),
            "weights": lambda: self.weigh(weights="gauss"),
            "beta": lambda: self.weigh(beta=0.0),
            "tolerance": lambda: self.weigh(tolerance=1.0),
            "threads = -1": lambda: self.weigh(threads=-1),
            "normalize": lambda: self.weigh(normalize="sinkhorn:0"),
            "solver": lambda: cfreg.solve(self.moments, solver="lapack"),
            "scale": lambda: cfreg.solve(self.moments, scale="none"),
        }.items():
            with self.subTest(argument), self.assertRaisesRegex(ValueError, f"^{argument}"):
                call()

    def test_an_automatic_bandwidth_is_a_share_of_the_median_least_distance(self):
        other = np.random.default_rng(6).normal(size=(300, 8))
        d2 = ((self.descriptors[:, None] - other[None]) ** 2).sum(axis=2)
        least = np.sort(np.concatenate([d2.min(axis=0), d2.min(axis=1)]))

        def weight(beta):
            return cfreg.moments(self.points, self.moved, self.descriptors, other, beta=beta).weight

        for share in (0.25, 2.0):
            expected = np.exp(-d2 / (share * least[300])).sum()
            word = "auto" if share == 0.25 else f"auto:{share}"
            self.assertAlmostEqual(weight(word) / expected, 1.0, places=4)
        for wrong in ("wide", "auto:0", "auto:x"):
            with self.assertRaisesRegex(ValueError, "^beta"):
                weight(wrong)

    def test_what_cannot_be_solved_is_its_own_error(self):
        far = self.descriptors + 1e4
        with self.assertRaisesRegex(cfreg.RegistrationError, "no connection has any weight"):
            cfreg.moments(self.points, self.moved, self.descriptors, far, beta=1e-2)
        line = np.outer(np.arange(300.0), [1.0, 2.0, 3.0])
        along = cfreg.moments(line, line, self.descriptors, self.descriptors, beta=1e-2)
        with self.assertRaisesRegex(cfreg.RegistrationError, "do not determine a rotation"):
            cfreg.solve(along)
        self.assertTrue(issubclass(cfreg.RegistrationError, ValueError))

    def test_pairs_of_ones_own_are_summed(self):
        pairs = np.column_stack([np.arange(300), np.arange(300)])
        weights = np.linspace(0.0, 1.0, 300)
        for given in (pairs, pairs.astype(np.int32), pairs.astype(np.uint8, casting="unsafe")[:256]):
            found = cfreg.moments_of_pairs(self.points, self.moved, given, weights[: len(given)])
            self.assertAlmostEqual(found.weight, weights[: len(given)].sum(), places=5)
            np.testing.assert_allclose(cfreg.solve(found), self.truth, atol=1e-6)
        self.assertEqual(cfreg.moments_of_pairs(self.points, self.moved, pairs).weight, 300.0)
        for argument, call in {
            "pairs: expected shape": lambda: cfreg.moments_of_pairs(self.points, self.moved, pairs[0]),
            "pairs: 18446744073709551615": lambda: cfreg.moments_of_pairs(
                self.points, self.moved, np.full((1, 2), 2**64 - 1, dtype=np.uint64)
            ),
            "weights: expected shape": lambda: cfreg.moments_of_pairs(
                self.points, self.moved, pairs, np.ones((150, 2))
            ),
            "pairs: -1": lambda: cfreg.moments_of_pairs(self.points, self.moved, pairs - 1),
            "points of the target, for a pair with its point 9: expected 10, found 9": lambda: cfreg.moments_of_pairs(self.points, self.moved[:9], pairs),
            "weights: expected 300": lambda: cfreg.moments_of_pairs(
                self.points, self.moved, pairs, weights[1:]
            ),
            "weights = -1": lambda: cfreg.moments_of_pairs(self.points, self.moved, pairs, weights - 1.0),
        }.items():
            with self.subTest(argument), self.assertRaisesRegex(ValueError, f"^{argument}"):
                call()
        # Rows of a cloud that has left some out are not those of its array.
        holed = self.points.copy()
        holed[3] = np.nan
        for call in (
            lambda: cfreg.moments_of_pairs(cfreg.PointCloud(holed), self.moved, pairs[:9]),
            lambda: cfreg.register(self.points, cfreg.PointCloud(holed), "teaser", matches=pairs[:9]),
        ):
            with self.assertRaisesRegex(cfreg.ShapeError, "^(source_points|target): .* left out 1 rows"):
                call()
        with self.assertRaisesRegex(cfreg.Error, "^pairs must be integers"):
            cfreg.moments_of_pairs(self.points, self.moved, pairs.astype(float))

    def test_a_tolerance_leaves_out_no_more_than_it_says(self):
        rng = np.random.default_rng(0)
        points = rng.normal(size=(8000, 3))
        kinds = 10.0 * rng.normal(size=(40, 12))
        descriptors = kinds[rng.integers(0, 40, 8000)] + rng.normal(size=(8000, 12))

        def weight(tolerance):
            return cfreg.moments(points, points, descriptors, descriptors, beta=50, tolerance=tolerance).weight

        exact = weight(0.0)
        kernel = cfreg.weights.Gaussian(50)
        alone = cfreg.moments(points, points, descriptors, descriptors, weights=kernel, tolerance=1e-3)
        self.assertEqual(alone.weight, weight(1e-3))
        with self.assertRaisesRegex(cfreg.SettingError, "^tolerance"):
            cfreg.moments(points, points, descriptors, descriptors, weights=kernel * kernel, tolerance=1e-3)
        for tolerance in (1e-6, 1e-3, 0.1):
            left_out = 1.0 - weight(tolerance) / exact
            # Something is left out, or there would be nothing to promise.
            self.assertTrue(1e-12 < left_out <= tolerance, f"{tolerance}: {left_out}")

    def test_descriptors_far_from_zero_keep_their_differences(self):
        near = np.arange(300.0)[:, None] * 0.1
        weigh = lambda *sides: cfreg.moments(self.points, self.points, *sides, beta=0.01).weight
        expected = weigh(near, near)
        self.assertAlmostEqual(weigh(near + 5.6e6, near + 5.6e6), expected, delta=1e-5 * expected)
        # Also where one side alone is float64.
        mixed = weigh((near + 1e3).astype(np.float32), near + 1e3)
        self.assertAlmostEqual(mixed, expected, delta=1e-2 * expected)

    def test_threads_change_no_bit(self):
        for normalize in ("none", "both", "sinkhorn:3"):
            found = [self.weigh(beta=10.0, normalize=normalize, threads=n) for n in (1, 2, 3)]
            for other in found[1:]:
                np.testing.assert_array_equal(found[0].cross, other.cross)
                self.assertEqual(found[0].weight, other.weight)

    def test_repr_is_one_readable_line(self):
        self.assertRegex(repr(self.moments), r"^Moments\(weight=\d+\.\d+, effective.*\)$")


if __name__ == "__main__":
    unittest.main()
