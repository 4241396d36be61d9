"""Weights and channels of points, from arrays to a pose."""

import os
import pathlib
import pickle
import tempfile
import types
import unittest

import cfreg
import numpy as np


def ball(seed):
    points = np.random.default_rng(seed).normal(size=(600, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    x, y, z = points.T
    return points, {"red": np.sin(1.3 * x + 0.4 * y * z), "glow": z + 0.3 * x * y + 0.5 * y}


class Carried(unittest.TestCase):
    def setUp(self):
        points = np.array([[0.0, 0, 0], [np.nan, 0, 0], [1, 0, 0], [0, 1, 0]])
        self.points = points
        self.cloud = cfreg.PointCloud(
            points, weights=np.array([1, -1, 0.5, 2]), channels={"intensity": np.arange(4)}
        )

    def test_what_is_dropped_takes_its_own_along(self):
        self.assertEqual(self.cloud.weights.tolist(), [1.0, 0.5, 2.0])
        self.assertEqual(self.cloud.channels["intensity"].tolist(), [0.0, 2.0, 3.0])
        self.assertFalse(self.cloud.channels["intensity"].flags.writeable)

    def test_pickles_and_files_keep_them(self):
        self.assertEqual(pickle.loads(pickle.dumps(self.cloud)), self.cloud)
        path = os.path.join(tempfile.mkdtemp(), "a.ply")
        cfreg.write(path, self.cloud)
        found = cfreg.read(path)
        self.assertEqual(found.weights.tolist(), self.cloud.weights.tolist())
        self.assertEqual(list(found.channels), ["intensity"])

    def test_faults_are_named(self):
        make = lambda **has: cfreg.PointCloud(self.points[[0, 2, 3]], **has)
        with self.assertRaisesRegex(cfreg.ShapeError, "weights"):
            make(weights=np.ones(2))
        with self.assertRaisesRegex(cfreg.SettingError, "weights = -1"):
            make(weights=np.array([1.0, -1, 1]))
        with self.assertRaisesRegex(cfreg.NonFiniteError, "red"):
            make(channels={"red": np.array([0, np.nan, 1])})
        with self.assertRaisesRegex(cfreg.Error, r'channels\["i"\]: must be numbers'):
            make(channels={"i": ["a", "b", "c"]})
        with self.assertRaisesRegex(cfreg.SettingError, "channels = a b"):
            make(channels={"a b": np.zeros(3)})

    def test_colours_of_open3d_come_along(self):
        colors = np.random.default_rng(0).random((4, 3))
        foreign = types.SimpleNamespace(
            points=self.points, normals=[], colors=colors, has_normals=lambda: False
        )
        found = cfreg.PointCloud(foreign).channels
        np.testing.assert_allclose(found["green"], colors[[0, 2, 3], 1].astype(np.float32))

    def test_colours_of_open3d_are_written_as_whole_numbers(self):
        colors = np.random.default_rng(0).random((4, 3))
        foreign = types.SimpleNamespace(
            points=self.points, normals=[], colors=colors, has_normals=lambda: False
        )
        cloud = cfreg.PointCloud(foreign)
        with tempfile.TemporaryDirectory() as folder:
            for number, one in enumerate((cloud, pickle.loads(pickle.dumps(cloud)))):
                path = pathlib.Path(folder, f"{number}.ply")
                cfreg.write(path, one)
                self.assertIn(b"property uchar green\n", path.read_bytes())
                back = cfreg.read(path).channels["green"]
                levels = np.round(255 * cloud.channels["green"])
                np.testing.assert_allclose(back, levels / 255, 1e-6)
                plain = cfreg.PointCloud(one.points, channels=one.channels)
                cfreg.write(path, plain)
                self.assertIn(b"property float green\n", path.read_bytes())


class Registered(unittest.TestCase):
    def test_channels_turn_a_ball_back(self):
        turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
        points, channels = ball(1)
        others, painted = ball(2)
        source = cfreg.PointCloud(points, channels=channels)
        target = cfreg.PointCloud(others @ turn.T, channels=painted)
        pose = {}
        for names in ((), ("red", "glow:1")):
            method = cfreg.CF(neighbors=30, orientation="outward", normalize="both", channels=names)
            pose[names] = method.register(source, target).transform[:3, :3]
        self.assertLess(np.linalg.norm(pose["red", "glow:1"] - turn), 0.2)
        self.assertGreater(np.linalg.norm(pose[()] - turn), 0.5)
        with self.assertRaisesRegex(cfreg.SettingError, "the source has no such channel"):
            cfreg.register(source, target, "cf", channels="blue")

    def test_points_of_no_weight_are_not_there(self):
        x, y = np.random.default_rng(0).uniform(-1, 1, (2, 800))
        points = np.column_stack([x, y, 0.4 * np.sin(3 * x + y)])
        weights = (np.arange(800) % 3 > 0).astype(float)
        target = points[:400] + [0.02, 0.01, 0.0]
        zero = cfreg.ICP().register(cfreg.PointCloud(points, weights=weights), target)
        gone = cfreg.ICP().register(points[weights > 0], target)
        np.testing.assert_allclose(zero.transform, gone.transform, atol=1e-6)


if __name__ == "__main__":
    unittest.main()
