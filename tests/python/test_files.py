"""Files of other programs, with their own libraries as judges: laspy, plyfile, trimesh, Open3D."""

import os
import tempfile
import unittest

import laspy
import numpy as np
import plyfile
import trimesh

import cfreg

RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-50, 50, (300, 3)) + [450000, 5400000, 300]


def turn() -> np.ndarray:
    """A turn about the middle of the points, and a step."""
    pose, middle = np.eye(4), np.array([450000, 5400000, 300])
    pose[:2, :2] = [[0.8, -0.6], [0.6, 0.8]]
    pose[:3, 3] = middle - pose[:3, :3] @ middle + [10, 20, 0.5]
    return pose


def moved(points):
    pose = turn()
    return points @ pose[:3, :3].T + pose[:3, 3]


class Files(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def at(self, name):
        return os.path.join(self.folder, name)

    def test_las_moves_with_all_that_it_has(self):
        for form, version, name in ((3, "1.2", "a.las"), (7, "1.4", "a.laz")):
            header = laspy.LasHeader(point_format=form, version=version)
            header.scales, header.offsets = [1e-3] * 3, [450000, 5400000, 0]
            header.add_extra_dim(laspy.ExtraBytesParams(name="glow", type=np.float64))
            scan = laspy.LasData(header)
            scan.x, scan.y, scan.z = POINTS.T
            scan.intensity = RNG.integers(0, 65535, len(POINTS))
            scan.classification = RNG.integers(0, 31, len(POINTS))
            scan.gps_time = RNG.uniform(0, 1e6, len(POINTS))
            scan.red = RNG.integers(256, 65535, len(POINTS))
            scan.glow = RNG.normal(size=len(POINTS))
            scan.write(self.at(name))
            for other in ("b.las", "b.laz"):
                said = cfreg.apply(self.at(name), turn(), self.at(other))
                self.assertIn("0.5 mm", said)
                found = laspy.read(self.at(other))
                self.assertEqual(found.header.point_format.id, form)
                self.assertEqual(str(found.header.version), version)
                places = np.column_stack([found.x, found.y, found.z])
                expected = moved(np.column_stack([scan.x, scan.y, scan.z]))
                self.assertLess(np.abs(places - expected).max(), 0.00051)
                for column in scan.point_format.dimension_names:
                    if column not in ("X", "Y", "Z"):
                        np.testing.assert_array_equal(found[column], scan[column], column)
            cloud = cfreg.read(self.at(name))
            np.testing.assert_allclose(cloud.points, np.column_stack([scan.x, scan.y, scan.z]), atol=1e-5)
            self.assertEqual(len(cfreg.PointCloud(scan)), len(POINTS))

    def test_written_clouds_are_those_of_laspy_and_plyfile(self):
        channels = {name: RNG.integers(0, 256, 300) / 255 for name in ("red", "green", "blue")}
        cloud = cfreg.PointCloud(POINTS, normals=np.tile([0, 0.6, 0.8], (300, 1)), channels=channels)
        scan = cloud.to_laspy()
        self.assertLess(np.abs(np.column_stack([scan.x, scan.y, scan.z]) - POINTS).max(), 1e-5)
        np.testing.assert_allclose(np.asarray(scan["ny"]), 0.6, rtol=1e-6)
        cfreg.write(self.at("a.ply"), cloud)
        vertices = plyfile.PlyData.read(self.at("a.ply"))["vertex"]
        self.assertLess(np.abs(np.column_stack([vertices[k] for k in "xyz"]) - POINTS).max(), 1e-5)
        self.assertIn("red", [one.name for one in vertices.properties])

    def test_meshes_move_with_their_faces(self):
        mesh = trimesh.creation.icosphere(2)
        for name in ("m.stl", "m.obj", "m.off", "m.ply"):
            mesh.export(self.at(name))
            self.assertEqual(len(cfreg.read(self.at(name))), len(mesh.vertices), name)
            cfreg.apply(self.at(name), np.diag([-1.0, -1, 1, 1]), self.at("moved-" + name))
            found = trimesh.load(self.at("moved-" + name))
            self.assertEqual(found.faces.shape, mesh.faces.shape, name)
            self.assertLess(np.abs(found.bounds - mesh.bounds).max(), 1e-6, name)

    def test_clouds_are_cut_and_joined_as_arrays_are(self):
        cloud = cfreg.PointCloud(POINTS, channels={"glow": np.arange(300.0)})
        np.testing.assert_array_equal(cloud[10:20].channels["glow"], np.arange(10.0, 20))
        self.assertEqual(len(cloud[cloud.channels["glow"] > 250]), 49)
        self.assertEqual(len(cloud[-1]), 1)
        self.assertRaises(IndexError, lambda: cloud[300])
        both = cloud[:5] + cloud[5:]
        np.testing.assert_allclose(both.points, cloud.points, atol=1e-5)
        self.assertRaises(TypeError, lambda: cloud + 1)
        self.assertEqual(len(cloud.voxel_down_sample(1000)), len(cloud.voxel(1000)))

    def test_clouds_of_double_precision_go_to_open3d(self):
        open3d = __import__("open3d")
        made = cfreg.PointCloud(POINTS).to_open3d()
        np.testing.assert_allclose(np.asarray(made.points), POINTS, atol=1e-5)
        self.assertIsInstance(made, open3d.geometry.PointCloud)


if __name__ == "__main__":
    unittest.main()
