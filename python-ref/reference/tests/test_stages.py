"""The oracle, tested: identities that define each stage, and Open3D beside it.

Run `python -m unittest` in this folder.
"""

import unittest

import numpy as np

import reference as ref
from peers.programs import open3d
from reference.fpfh import simplified
from reference.moments import Moments
from reference.rotations import random_rotation
from reference.surfaces import VIEWPOINT, as_f32, relief


def weighted_pairs(rng, count=60, noise=0.05, flat=False, mirror=False):
    """Moments of `count` x `count` connections between a random cloud and its moved,
    noisy copy, and the clouds and weights themselves."""
    source = rng.normal(size=(count, 3)) * [1.0, 0.7, 0.0 if flat else 0.4]
    shape = np.diag([1.0, 1.0, -1.0]) if mirror else np.eye(3)
    target = source @ (random_rotation(rng) @ shape).T + rng.normal(size=3)
    target += noise * rng.normal(size=target.shape)
    weights = np.exp(-6.0 * rng.random((count, count))) + 10.0 * np.eye(count)
    return source, target, weights


class Neighbours(unittest.TestCase):
    def test_the_point_itself_comes_first_and_ties_go_to_the_lower_index(self):
        line = np.array([[float(x), 0.0, 0.0] for x in range(7)])
        indices, squared = ref.nearest(line, 2)
        self.assertEqual(indices.tolist(), [[0, 1], [1, 0], [2, 1], [3, 2], [4, 3], [5, 4], [6, 5]])
        self.assertEqual(squared[:, 1].tolist(), [1.0] * 7)
        self.assertEqual(ref.separation(line, 2)[1:6].tolist(), [0.0] * 5)

    def test_fewer_points_than_k(self):
        indices, _ = ref.nearest(np.eye(3), 10)
        self.assertEqual(indices.shape, (3, 3))


class Normals(unittest.TestCase):
    def test_a_plane_has_its_normal_and_no_curvature(self):
        rng = np.random.default_rng(1)
        flat = np.column_stack([rng.random((200, 2)), np.full(200, 2.0)])
        found, curvature = ref.normals(flat, 20)
        np.testing.assert_allclose(found, np.tile([0.0, 0.0, -1.0], (200, 1)), atol=1e-12)
        np.testing.assert_allclose(curvature, 0.0, atol=1e-14)

    def test_open3d_finds_the_same(self):
        points = relief(800, np.random.default_rng(2))
        found, _ = ref.normals(points, 40, VIEWPOINT)
        np.testing.assert_allclose(found, open3d.normals(points, 40, VIEWPOINT), atol=1e-9)


class Fpfh(unittest.TestCase):
    def setUp(self):
        self.points = relief(600, np.random.default_rng(3))
        # Points with the same neighbours have the same normal but for rounding, and
        # rounding would decide which of the two comes first: in f32 they are equal.
        self.normals = as_f32(ref.normals(self.points, 40, VIEWPOINT)[0])

    def test_blocks_sum_to_100_and_200(self):
        for scale, total in (("pcl", 100.0), ("open3d", 200.0)):
            blocks = ref.fpfh(self.points, self.normals, 40, scale).reshape(-1, 3, 11)
            np.testing.assert_allclose(blocks.sum(axis=2), total, rtol=1e-12)

    def test_a_rigid_motion_changes_nothing(self):
        rotation = random_rotation(np.random.default_rng(4))
        turned = np.einsum("ij,nj->ni", rotation, self.normals)
        moved = ref.fpfh(self.points @ rotation.T + 3.0, turned, 40)
        still = ref.fpfh(self.points, self.normals, 40)
        self.assertLess(np.abs(moved - still).sum(axis=1).max(), 1e-6)

    def test_open3d_computes_the_same_from_its_own_normals(self):
        cloud, search = open3d.cloud(self.points), open3d.nearest(40)
        cloud.estimate_normals(search)
        theirs = open3d.feature(cloud, search).data.T
        ours = ref.fpfh(self.points, np.asarray(cloud.normals), 40, "open3d")
        np.testing.assert_allclose(ours, theirs, atol=1e-9)

    def test_a_degenerate_pair_falls_in_the_middle_bins_as_in_open3d(self):
        points = np.vstack([self.points[:80], self.points[:1], self.points[1:2] + [0, 0, 1e-3]])
        normals = np.vstack([self.normals[:80], self.normals[:1], [[0.0, 0.0, 1.0]]])
        normals[1] = [0.0, 0.0, 1.0]
        theirs = open3d.fpfh(points, normals, 12)
        np.testing.assert_allclose(ref.fpfh(points, normals, 12, "open3d"), theirs, atol=1e-9)
        indices, _ = ref.nearest(points, 2)
        np.testing.assert_array_equal(simplified(points, normals, indices)[0].nonzero()[0], [5, 16, 27])


class Weights(unittest.TestCase):
    def test_every_kernel_is_1_at_0_and_falls(self):
        d2 = np.linspace(0.0, 1000.0, 501)
        for kernel in ref.KERNELS:
            with self.subTest(kernel):
                weights = ref.weigh(d2, kernel)
                self.assertEqual(weights[0], 1.0)
                self.assertTrue((np.diff(weights) <= 0).all() and (weights >= 0).all())

    def test_sums_after_normalisation(self):
        weights = np.random.default_rng(5).random((20, 30)) + 0.1
        np.testing.assert_allclose(ref.normalise(weights, "source").sum(axis=1), 1.0)
        np.testing.assert_allclose(ref.normalise(weights, "target").sum(axis=0), 1.0)
        balanced = ref.normalise(weights, "sinkhorn:100")
        np.testing.assert_allclose(balanced.sum(axis=1), 1.0 / 20, rtol=1e-12)
        np.testing.assert_allclose(balanced.sum(axis=0), 1.0 / 30, rtol=1e-12)

    def test_empty_rows_stay_empty(self):
        weights = np.array([[0.0, 0.0], [1.0, 3.0]])
        for name in ("source", "target", "both", "sinkhorn:3"):
            self.assertEqual(ref.normalise(weights, name)[0].tolist(), [0.0, 0.0])


class Sums(unittest.TestCase):
    def test_moments_and_residual_are_the_double_sums(self):
        source, target, weights = weighted_pairs(np.random.default_rng(6), count=9)
        sums = ref.moments(weights, source, target)
        pose = ref.Pose(1.3, random_rotation(np.random.default_rng(7)), np.array([1.0, -2.0, 0.5]))
        cross, residual = np.zeros((3, 3)), 0.0
        for i, p in enumerate(source):
            for j, q in enumerate(target):
                cross += weights[i, j] * np.outer(p - sums.source_origin, q - sums.target_origin)
                error = pose.scale * pose.rotation @ p + pose.translation - q
                residual += weights[i, j] * error @ error
        np.testing.assert_allclose(sums.cross, cross, rtol=1e-12, atol=1e-12)
        found = ref.weighted_residual(sums, pose.scale, pose.rotation, pose.translation)
        self.assertAlmostEqual(found / residual, 1.0, places=12)

    def test_equal_connections_count_fully(self):
        source, target, _ = weighted_pairs(np.random.default_rng(8), count=9)
        sums = ref.moments(np.full((9, 9), 0.25), source, target)
        self.assertAlmostEqual(ref.effective_connections(sums), 81.0)


class Poses(unittest.TestCase):
    def problems(self):
        kinds = ({}, {"flat": True, "noise": 0.0}, {"mirror": True}, {"noise": 0.3})
        for seed in range(40):
            rng = np.random.default_rng(100 + seed)
            source, target, weights = weighted_pairs(rng, **kinds[seed % len(kinds)])
            yield seed, ref.moments(weights, source, target)

    def test_solvers_agree(self):
        for seed, sums in self.problems():
            for scale in ("fixed", "umeyama"):
                expected = ref.solve(sums, "arun", scale)
                self.assertAlmostEqual(np.linalg.det(expected.rotation), 1.0, places=12)
                for solver in ref.SOLVERS:
                    with self.subTest(seed=seed, solver=solver, scale=scale):
                        found = ref.solve(sums, solver, scale).matrix()
                        np.testing.assert_allclose(found, expected.matrix(), rtol=0, atol=1e-10)

    def test_no_small_motion_lowers_the_residual(self):
        for seed, sums in self.problems():
            pose = ref.solve(sums, "arun", "umeyama")
            least = ref.weighted_residual(sums, pose.scale, pose.rotation, pose.translation)
            rng = np.random.default_rng(seed)
            for _ in range(20):
                rotation = random_rotation(rng, degrees=1.0) @ pose.rotation
                scale = pose.scale * (1 + 0.01 * rng.normal())
                shifted = pose.translation + 0.01 * rng.normal(size=3)
                self.assertGreater(ref.weighted_residual(sums, scale, rotation, shifted), least)

    def test_a_known_similarity_comes_back(self):
        rng = np.random.default_rng(9)
        source, rotation, shift = rng.normal(size=(50, 3)), random_rotation(rng), rng.normal(size=3)
        target = 1.7 * source @ rotation.T + shift
        pose = ref.solve(ref.moments(np.eye(50), source, target), "arun", "umeyama")
        self.assertAlmostEqual(pose.scale, 1.7, places=12)
        np.testing.assert_allclose(pose.rotation, rotation, atol=1e-12)
        np.testing.assert_allclose(pose.translation, shift, atol=1e-12)

    def test_a_line_is_refused(self):
        line = np.outer(np.linspace(-1, 1, 20), [1.0, 2.0, 3.0])
        sums = ref.moments(np.eye(20), line, line)
        self.assertIsInstance(sums, Moments)
        with self.assertRaises(ref.SingularError):
            ref.solve(sums)


if __name__ == "__main__":
    unittest.main()
