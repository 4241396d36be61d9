"""Normals, keypoints and descriptors."""

import unittest

import cfreg
import numpy as np
from shapes import terrain


class Features(unittest.TestCase):
    def test_normals_are_unit_and_face_the_viewpoint(self):
        points = terrain(500)
        normals, curvature = cfreg.estimate_normals(points, neighbors=20)
        self.assertEqual((normals.shape, normals.dtype), ((500, 3), np.float32))
        self.assertEqual((curvature.shape, curvature.dtype), ((500,), np.float32))
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
        self.assertTrue((np.einsum("ij,ij->i", normals, points) < 0.0).all())
        self.assertTrue(((0.0 <= curvature) & (curvature <= 1 / 3 + 1e-6)).all())
        below, _ = cfreg.estimate_normals(points, neighbors=20, viewpoint=(0.0, 0.0, -9.0))
        self.assertLess(np.median(below[:, 2]), 0.0)
        # Any sequence is a viewpoint.
        again, _ = cfreg.estimate_normals(points, 20, np.array([0, 0, -9]))
        np.testing.assert_array_equal(below, again)

    def test_what_was_estimated_is_normals(self):
        points = terrain(500)
        estimated = cfreg.estimate_normals(points, neighbors=20)
        cloud = cfreg.PointCloud(points, normals=estimated)
        self.assertEqual(cloud, cfreg.PointCloud(points, normals=estimated[0]))
        by_all = cfreg.fpfh(points, 20, normals=estimated)
        np.testing.assert_array_equal(by_all, cfreg.fpfh(points, 20, normals=estimated[0]))

    def test_normals_of_points_that_were_left_out(self):
        holes = terrain(500)
        holes[[3, 7]] = np.nan
        cloud = cfreg.PointCloud(holes)
        estimated = cfreg.estimate_normals(cloud, neighbors=20)
        self.assertEqual(estimated[0].shape, (498, 3))
        furnished = cfreg.PointCloud(cloud, normals=estimated)
        np.testing.assert_allclose(furnished.normals, estimated[0], atol=1e-6)
        self.assertEqual((len(furnished), furnished.dropped), (498, 2))
        with self.assertRaisesRegex(
            cfreg.ShapeError, "^normals: expected 500 rows, as points has, found 498: 2 rows of points are not finite"
        ):
            cfreg.PointCloud(holes, normals=estimated)
        with self.assertRaisesRegex(
            cfreg.ShapeError, "^normals: expected 498 rows, as points has, found 500: this PointCloud has left out 2"
        ):
            cfreg.PointCloud(cloud, normals=terrain(500))
        with self.assertRaisesRegex(cfreg.ShapeError, "found 497$"):
            cfreg.PointCloud(cloud, normals=terrain(497))

    def test_histograms_have_their_scale(self):
        points = terrain(500)
        for scale, total in (("pcl", 300.0), ("open3d", 600.0)):
            found = cfreg.fpfh(points, neighbors=30, scale=scale)
            self.assertEqual((found.shape, found.dtype), ((500, 33), np.float32))
            np.testing.assert_allclose(found.sum(axis=1), total, rtol=1e-5)

    def test_estimated_normals_are_those_of_the_same_neighbourhood(self):
        points = terrain(500)
        normals, _ = cfreg.estimate_normals(points, neighbors=30)
        given = cfreg.fpfh(points, neighbors=30, normals=normals)
        apart = np.abs(given - cfreg.fpfh(points, neighbors=30)).sum(axis=1)
        # Scaling a unit normal again rounds its last bit, which may move a pair's bin.
        self.assertLess(np.median(apart), 0.01)
        np.testing.assert_array_equal(given, cfreg.fpfh(points, 30, normals=3.0 * normals.astype(float)))

    def test_keypoints_are_rows_in_order(self):
        points = terrain(2000)
        _, curvature = cfreg.estimate_normals(points)
        for detector in ("sift", "iss"):
            found = cfreg.keypoints(points, detector)
            self.assertTrue(10 < len(found) < 1000 and (np.diff(found.astype(int)) > 0).all())
            order = np.random.default_rng(0).permutation(len(points))
            again = cfreg.keypoints(points[order], detector, curvature[order])
            np.testing.assert_array_equal(np.sort(order[again]), found)
        coarse = cfreg.keypoints(points, min_scale=2.0, octaves=1, values=curvature.astype(float))
        self.assertLess(len(coarse), len(cfreg.keypoints(points)))
        for argument, call in {
            "detector = harris": lambda: cfreg.keypoints(points, "harris"),
            "detector = iss: unknown field `octaves`": lambda: cfreg.keypoints(points, "iss", octaves=1),
            "min_scale = -1": lambda: cfreg.keypoints(points, min_scale=-1.0),
            "values": lambda: cfreg.keypoints(points, values=curvature[1:]),
        }.items():
            with self.subTest(argument), self.assertRaisesRegex(ValueError, f"^{argument}"):
                call()
        listed = cfreg.keypoints(points, values=curvature.tolist())
        np.testing.assert_array_equal(listed, cfreg.keypoints(points, values=curvature))
        with self.assertRaisesRegex(cfreg.Error, "^values must be"):
            cfreg.keypoints(points, values="curvature")

    def test_settings_are_refused_by_name(self):
        points = terrain(50)
        hole = points.copy()
        hole[7, 1] = np.nan
        for argument, call in {
            "points": lambda: cfreg.estimate_normals(hole),
            "neighbors": lambda: cfreg.fpfh(points, neighbors=2),
            "scale": lambda: cfreg.fpfh(points, scale="pcl2"),
            "viewpoint": lambda: cfreg.fpfh(points, viewpoint=(0.0, np.inf, 0.0)),
            "normals": lambda: cfreg.fpfh(points, normals=points[1:]),
        }.items():
            with self.subTest(argument), self.assertRaisesRegex(ValueError, f"^{argument}"):
                call()
        with self.assertRaisesRegex(ValueError, "^points.* row 7"):
            cfreg.fpfh(hole)
        with self.assertRaisesRegex(ValueError, "^normals.* row 7"):
            cfreg.fpfh(points, normals=hole)
        with self.assertRaisesRegex(ValueError, "^viewpoint.*normals"):
            cfreg.fpfh(points, viewpoint=(0, 0, 1), normals=points)

    def test_no_points_are_an_error(self):
        with self.assertRaisesRegex(cfreg.RegistrationError, "0 usable points"):
            cfreg.estimate_normals(np.zeros((0, 3)))


if __name__ == "__main__":
    unittest.main()
