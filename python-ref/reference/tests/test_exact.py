"""The 50-digit oracle: identities that hold to 45 digits, and numpy beside it."""

import itertools
import unittest

import mpmath
import numpy as np

import reference as ref
from reference.comparisons.exact_poses import PAIRS, PROBLEMS, pairs
from reference import exact
from reference.exact.moments import KERNELS, squared_distances, transposed
from reference.exact.numbers import applied, cross, dot, minus, mp, norm
from reference.exact.surface import bins_of
from reference.surfaces import VIEWPOINT, as_f32, relief

TINY = mp.mpf(10) ** -45


def sums_of(name):
    source, target = pairs(np.random.default_rng(1), **PROBLEMS[name])
    found = ref.moments(np.eye(PAIRS), source, target)
    return found, exact.Sums.from_moments(found)


class Numbers(unittest.TestCase):
    def test_floats_are_binary_and_text_is_decimal(self):
        self.assertEqual(exact.exact(0.1), mp.mpf(3602879701896397) / 2**55)
        self.assertEqual(exact.exact("0.1"), mp.mpf(1) / 10)

    def test_nobody_elses_precision_changes(self):
        self.assertEqual(mpmath.mp.dps, 15)


class Weights(unittest.TestCase):
    def setUp(self):
        rng = np.random.default_rng(2)
        self.descriptors = [as_f32(rng.normal(size=(n, 5))) for n in (9, 7)]
        self.d2 = squared_distances(*map(exact.rows, self.descriptors))

    def test_numpy_has_the_same_for_every_kernel_and_normalisation(self):
        d2 = ref.squared_distances(*self.descriptors)
        names = ("none", "source", "target", "both", "sinkhorn:3")
        self.assertEqual(set(KERNELS), set(ref.KERNELS))
        for kernel, normalisation in itertools.product(KERNELS, names):
            with self.subTest(kernel=kernel, normalisation=normalisation):
                expected = ref.normalise(ref.weigh(d2, kernel, 9.0, 3.0), normalisation)
                found = exact.as_float(exact.weights(self.d2, kernel, 9.0, 3.0, normalisation))
                np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-16)
                self.assertGreater(found.max(), 0.0)

    def test_normalised_rows_and_columns_have_their_sums(self):
        by_source = exact.weights(self.d2, "cauchy", 9.0, normalisation="source")
        balanced = exact.weights(self.d2, "cauchy", 9.0, normalisation="sinkhorn:3")
        for row in by_source:
            self.assertLess(abs(mp.fsum(row) - 1), TINY)
        for column in transposed(balanced):
            self.assertLess(abs(mp.fsum(column) - mp.mpf(1) / 7), TINY)


class Residual(unittest.TestCase):
    def test_it_is_the_double_sum(self):
        rng = np.random.default_rng(3)
        source, target = (exact.rows(rng.normal(size=(n, 3))) for n in (8, 6))
        table = exact.rows(rng.random((8, 6)))
        origins = exact.rows(rng.normal(size=(2, 3)))
        sums = exact.moments(table, source, target, *origins)
        for scale in ("fixed", "umeyama", "symmetric"):
            matrix = exact.solve(sums, scale).matrix()
            expected = exact.residual_of_pairs(table, source, target, matrix)
            self.assertLess(abs(exact.residual(sums, matrix) / expected - 1), TINY)


class Poses(unittest.TestCase):
    def test_rotations_are_rotations_and_numpy_finds_them(self):
        for name, scale in itertools.product(PROBLEMS, ("fixed", "umeyama", "symmetric")):
            with self.subTest(name=name, scale=scale):
                found, sums = sums_of(name)
                best = exact.solve(sums, scale)
                for a, b in itertools.product(range(3), repeat=2):
                    error = dot(best.rotation[a], best.rotation[b]) - (a == b)
                    self.assertLess(abs(error), TINY)
                self.assertLess(norm(minus(cross(*best.rotation[:2]), best.rotation[2])), TINY)
                expected = ref.solve(found, "arun", scale)
                slack = 1e-14 * float(best.condition("arun"))
                np.testing.assert_allclose(exact.as_float(best.rotation), expected.rotation, atol=slack)
                self.assertAlmostEqual(float(best.scale) / expected.scale, 1.0, delta=slack)

    def test_singular_values_give_the_same_rotation(self):
        for name in ("noise", "reflection", "reflection, s3 of s2: 1 - 1e-3", "plane: rank 2"):
            with self.subTest(name):
                _, sums = sums_of(name)
                products = mp.matrix(sums.source_sum) * mp.matrix(sums.target_sum).T
                u, values, v = mp.svd_r(mp.matrix(sums.cross) - products / sums.weight)
                sign = 1 if mp.det(u) * mp.det(v) > 0 else -1
                rotation = (u * mp.diag([1, 1, sign]) * v).T
                best = exact.solve(sums)
                self.assertLess(mp.mnorm(rotation - mp.matrix(best.rotation), "f"), mp.mpf(10) ** -40)
                signed = [values[0], values[1], sign * values[2]]
                self.assertLess(norm(minus(best.singular_values, signed)), TINY * values[0])

    def test_scales_are_what_they_are_named_after(self):
        _, sums = sums_of("scale 1.7")
        best = exact.solve(sums, "umeyama")
        least = exact.residual(sums, best.matrix())
        for factor in ("0.999", "1.001"):
            other = [[x * exact.exact(factor) for x in row] for row in best.matrix()[:3]]
            self.assertGreater(exact.residual(sums, other + best.matrix()[3:]), least)
        swapped = exact.Sums(
            **{
                **vars(sums),
                "source_sum": sums.target_sum,
                "target_sum": sums.source_sum,
                "cross": transposed(sums.cross),
                "source_squares": sums.target_squares,
                "target_squares": sums.source_squares,
                "source_origin": sums.target_origin,
                "target_origin": sums.source_origin,
            }
        )
        both = exact.solve(sums, "symmetric").scale * exact.solve(swapped, "symmetric").scale
        self.assertLess(abs(both - 1), TINY)

    def test_the_mean_goes_to_the_mean(self):
        _, sums = sums_of("UTM coordinates")
        best = exact.solve(sums)
        p = [o + s / sums.weight for o, s in zip(sums.source_origin, sums.source_sum)]
        q = [o + s / sums.weight for o, s in zip(sums.target_origin, sums.target_sum)]
        moved = [x + t for x, t in zip(applied(best.rotation, p), best.translation)]
        self.assertLess(norm(minus(moved, q)), mp.mpf(10) ** -40)


class Surfaces(unittest.TestCase):
    def test_the_normal_is_an_eigenvector_and_numpy_finds_it(self):
        points = relief(12, np.random.default_rng(4))
        normal, curvature, variances = exact.plane(exact.rows(points))
        centred = points - points.mean(axis=0)
        covariance = centred.T @ centred / len(points)
        n = exact.as_float(normal)
        np.testing.assert_allclose(covariance @ n, float(variances[0]) * n, atol=1e-15)
        self.assertLess(abs(norm(normal) - 1), TINY)
        found, expected = ref.normals(points, 12)
        np.testing.assert_allclose(np.abs(found @ n), 1.0, atol=1e-14)
        np.testing.assert_allclose(expected, float(curvature), atol=1e-14)

    def test_points_of_a_plane_have_no_curvature(self):
        grid = itertools.product(map(mp.mpf, range(3)), repeat=2)
        flat = [[x, y, (x + 2 * y) / 3] for x, y in grid]
        self.assertLess(exact.plane(flat)[1], TINY)

    def test_numpy_has_the_same_fpfh(self):
        points = relief(40, np.random.default_rng(5))
        normals = as_f32(ref.normals(points, 10, VIEWPOINT)[0])
        for scale, total in (("pcl", 100.0), ("open3d", 200.0)):
            found = exact.fpfh(exact.rows(points), exact.rows(normals), 10, scale)
            expected = ref.fpfh(points, normals, 10, scale)
            self.assertGreater(found.clear.mean(), 0.5)
            np.testing.assert_allclose(found.histograms[found.clear], expected[found.clear], atol=1e-11)
            blocks = found.histograms.reshape(-1, 3, 11)
            np.testing.assert_allclose(blocks.sum(axis=2), total, rtol=1e-14)

    def test_a_pair_at_the_edge_of_a_bin_is_not_clear(self):
        # The first normal makes the smaller angle with the line from p to q.
        p, n, q = [0.0, 0.0, 0.0], [0.1, 0.0, np.sqrt(0.99)], [1.0, 0.0, 0.0]
        for lift, clear in ((0.0, False), (1e-8, False), (1e-3, True)):
            # alpha = v . m with v = (0, -1, 0): at 1 / 11 the seventh bin begins.
            alpha = 1.0 / 11.0 + lift
            m = [0.01, -alpha, np.sqrt(1.0 - alpha**2 - 1e-4)]
            bins, found = bins_of(*exact.rows([p, n, q, m]))
            self.assertEqual(found, clear, f"{lift}: {bins}")
        self.assertEqual(bins[1], 6)


if __name__ == "__main__":
    unittest.main()
