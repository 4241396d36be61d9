"""What stands for a cloud: arrays of all kinds, PointCloud, clouds of other libraries."""

import os
import pickle
import tempfile
import unittest
from pathlib import Path
from types import SimpleNamespace

import cfreg
import numpy as np
from shapes import terrain, turned

try:
    import open3d
except ImportError:
    open3d = None
try:
    import small_gicp
except ImportError:
    small_gicp = None
try:
    import kiss_matcher
except ImportError:
    kiss_matcher = None
try:
    import trimesh
except ImportError:
    trimesh = None
try:
    import pyvista
except ImportError:
    pyvista = None


class Arrays(unittest.TestCase):
    """What counts as points."""

    def setUp(self):
        self.points = terrain(400).astype(np.float32).astype(np.float64)
        self.expected = cfreg.fpfh(self.points, neighbors=30)

    def same(self, points):
        np.testing.assert_array_equal(cfreg.fpfh(points, neighbors=30), self.expected)

    def test_float32_and_float64_are_alike(self):
        self.same(self.points.astype(np.float32))

    def test_strides_do_not_matter(self):
        self.same(np.asfortranarray(self.points))
        self.same(np.repeat(self.points, 2, axis=0)[::2])
        self.same(self.points[::-1].copy()[::-1])
        self.same(np.hstack([self.points, self.points])[:, :3])

    def test_packed_fields_are_read(self):
        # Rows of 13 bytes: no stride is a multiple of a float's size.
        packed = np.zeros(len(self.points), dtype=[("label", "i1"), ("xyz", "f4", 3)])
        packed["xyz"] = self.points
        self.same(packed["xyz"])

    def test_read_only_arrays_are_read_and_left_alone(self):
        self.points.setflags(write=False)
        self.same(self.points)

    def test_numbers_of_other_kinds_are_converted(self):
        whole = np.round(100 * self.points)
        expected = cfreg.PointCloud(whole)
        for rows in (
            whole.tolist(),
            [tuple(row) for row in whole.astype(int).tolist()],
            tuple(whole.astype(np.float32)),
            whole.astype(int),
            whole.astype(np.int16),
            whole.astype(">f8"),
            whole.astype(np.longdouble),
        ):
            self.assertEqual(cfreg.PointCloud(rows), expected)
        half = self.points.astype(np.float16)
        self.assertEqual(cfreg.PointCloud(half), cfreg.PointCloud(half.astype(float)))
        self.same(self.points.tolist())
        found = cfreg.register(self.points.tolist(), self.points.tolist(), "icp")
        np.testing.assert_array_equal(found.transform, cfreg.register(self.points, self.points, "icp").transform)
        np.testing.assert_allclose(found.apply(self.points.tolist()), self.points, atol=1e-6)

    def test_masked_integers_are_left_out(self):
        rows = np.ma.MaskedArray(np.arange(12).reshape(4, 3), np.arange(12).reshape(4, 3) == 7)
        self.assertEqual(cfreg.PointCloud(rows).dropped, 1)

    def test_what_is_no_number_is_refused_by_name(self):
        for wrong in (
            self.points.astype(complex),
            self.points > 0,
            self.points.astype(object),
            self.points.astype(str).tolist(),
            [[0.0, 0.0, None]],
            None,
            {"x": 1.0},
        ):
            with self.assertRaisesRegex(cfreg.Error, "^target must be"):
                cfreg.register(self.points, wrong)
        with self.assertRaisesRegex(FileNotFoundError, "no such.ply"):  # a text is a file
            cfreg.register(self.points, "no such.ply")
        for ragged in ([[0.0, 1.0, 2.0], [3.0]], [1.0, [2.0, 3.0, 4.0]]):
            with self.assertRaisesRegex(cfreg.ShapeError, "^target: rows differ in length"):
                cfreg.register(self.points, ragged)

    def test_other_shapes_are_refused_by_name(self):
        for shape in ((12,), (4, 4), (0,), (2, 3, 1), ()):
            with self.assertRaisesRegex(cfreg.ShapeError, r"^points: expected shape \(N, 3\), found"):
                cfreg.estimate_normals(np.zeros(shape))

    def test_what_becomes_an_array_is_one(self):
        class Tensor:
            def __array__(_, dtype=None, copy=None):
                return self.points

        self.same(Tensor())
        self.same(self.points.view(type("Tracked", (np.ndarray,), {})))

    def test_masked_rows_are_left_out(self):
        masked = np.ma.masked_array(self.points, mask=np.zeros(self.points.shape, bool))
        masked[3, 1] = np.ma.masked
        cloud = cfreg.PointCloud(masked)
        self.assertEqual((len(cloud), cloud.dropped), (399, 1))
        with self.assertRaisesRegex(cfreg.NonFiniteError, "^points .* row 3"):
            cfreg.fpfh(masked)


class Cloud(unittest.TestCase):
    def setUp(self):
        self.points = terrain(300)
        self.normals = np.random.default_rng(1).normal(size=(300, 3))

    def test_it_holds_what_it_was_given(self):
        self.points[5, 0] = np.inf
        cloud = cfreg.PointCloud(self.points, self.normals, viewpoint=(0, 0, 5))
        self.assertEqual((len(cloud), cloud.dropped), (299, 1))
        kept = np.delete(self.points, 5, axis=0)
        np.testing.assert_array_equal(cloud.points, kept.astype(np.float32))
        unit = self.normals / np.linalg.norm(self.normals, axis=1, keepdims=True)
        np.testing.assert_allclose(cloud.normals, np.delete(unit, 5, axis=0), atol=1e-6)
        self.assertEqual(cloud.viewpoint.tolist(), [0.0, 0.0, 5.0])
        np.testing.assert_allclose(cloud.bounds, [kept.min(axis=0), kept.max(axis=0)], atol=1e-6)
        self.assertGreater(cloud.resolution, 0.0)
        bare = cfreg.PointCloud(self.points)
        self.assertIsNone(bare.normals)
        self.assertIsNone(bare.viewpoint)

    def test_views_are_read_only_and_made_once(self):
        cloud = cfreg.PointCloud(self.points, self.normals)
        for view in (cloud.points, cloud.normals, cloud.bounds):
            self.assertFalse(view.flags.writeable)
        self.assertIs(cloud.points, cloud.points)
        self.assertIs(cloud.normals, cloud.normals)
        self.assertIs(np.asarray(cloud), cloud.points)
        self.assertEqual(np.array(cloud, dtype=np.float64).dtype, np.float64)
        self.assertIs(cloud.__array__(copy=False), cloud.points)
        other = np.float64 if cloud.points.dtype == np.float32 else np.float32
        with self.assertRaisesRegex(ValueError, "^copy: "):
            cloud.__array__(other, copy=False)
        with self.assertRaises(AttributeError):
            cloud.points = self.points

    def test_map_coordinates_lose_nothing(self):
        offset = np.array([5e5, 5.6e6, 300.0])
        near, far = cfreg.PointCloud(self.points), cfreg.PointCloud(self.points + offset)
        self.assertEqual((near.points.dtype, far.points.dtype), (np.float32, np.float64))
        np.testing.assert_allclose(far.points - offset, self.points, atol=2e-7)
        found = cfreg.register(far, near)
        np.testing.assert_allclose(found.apply(far).points, near.points, atol=1e-2)

    def test_pickles_are_the_same_bits(self):
        for offset in (0.0, [5e5, 5.6e6, 0.0]):
            cloud = cfreg.PointCloud(self.points + offset, self.normals, viewpoint=(1, 2, 3))
            again = pickle.loads(pickle.dumps(cloud))
            self.assertEqual(again, cloud)
            np.testing.assert_array_equal(cfreg.fpfh(again), cfreg.fpfh(cloud))
        self.assertNotEqual(cloud, cfreg.PointCloud(self.points))

    def test_it_tells_what_it_is(self):
        cloud = cfreg.PointCloud(np.array([[0, 0, 0], [1.5, 0, 1e-9], [np.nan, 0, 0]]), viewpoint=(0, 0, 9))
        shown = "PointCloud(2 points, 1 dropped, from [0, 0, 0] to [1.5, 0, 1.000e-9], seen from [0, 0, 9])"
        self.assertEqual(repr(cloud), shown)
        self.assertEqual(repr(cfreg.PointCloud(np.zeros((0, 3)))), "PointCloud(0 points)")

    def test_files_give_back_what_was_written(self):
        cloud = cfreg.PointCloud(self.points, self.normals)
        with tempfile.TemporaryDirectory() as folder:
            for name in ("a.ply", "a.pcd", "a.xyz", "a.csv"):
                path = Path(folder, name)
                cfreg.write(path, cloud)
                again = cfreg.read(str(path))
                np.testing.assert_array_equal(again.points, cloud.points)
                np.testing.assert_allclose(again.normals, cloud.normals, atol=1e-6)
            with self.assertRaises(FileNotFoundError) as caught:
                cfreg.read(Path(folder, "absent.ply"))
            self.assertEqual(caught.exception.filename, str(Path(folder, "absent.ply")))
            self.assertEqual(caught.exception.strerror, "No such file or directory")
            with self.assertRaisesRegex(cfreg.SettingError, "extension"):
                cfreg.write(Path(folder, "a.obj"), cloud)
            Path(folder, "lie.ply").write_text("ply\nformat ascii 1.0\nelement vertex 9\nend_header\n")
            with self.assertRaisesRegex(cfreg.FileFormatError, "lie.ply"):
                cfreg.read(Path(folder, "lie.ply"))

    def test_it_is_thinned_and_moved(self):
        cloud = cfreg.PointCloud(self.points, self.normals, viewpoint=(0, 0, 5))
        self.assertLess(len(cloud.voxel(0.2)), 200)
        drawn = cloud.sample(50, seed=3)
        self.assertEqual((len(drawn), drawn), (50, cloud.sample(50, seed=3)))
        self.assertNotEqual(drawn, cloud.sample(50, seed=4))
        moved, matrix = turned(self.points)
        there = cloud.transformed(matrix)
        np.testing.assert_allclose(there.points, moved, atol=1e-6)
        np.testing.assert_allclose(there.normals, cloud.normals @ matrix[:3, :3].T, atol=1e-6)
        for name, call in {
            "voxel": lambda: cloud.voxel(-1.0),
            "count": lambda: cloud.sample(0),
            "count = -1": lambda: cloud.sample(-1),
            "transform": lambda: cloud.transformed(2.0 * np.diag([1, 2, 1, 1])),
            "transform: must be a": lambda: cloud.transformed(np.eye(3)),
            "viewpoint": lambda: cfreg.PointCloud(self.points, viewpoint=(0, np.nan, 0)),
            r"viewpoint = \(1, 2\)": lambda: cfreg.PointCloud(self.points, viewpoint=(1, 2)),
            "viewpoint = 'up'": lambda: cfreg.fpfh(self.points, viewpoint="up"),
            "seed = -1": lambda: cloud.sample(5, seed=-1),
            "normals": lambda: cfreg.PointCloud(self.points, self.normals[1:]),
            "normals: expected 300 rows, as points has, found 299": lambda: cfreg.PointCloud(
                self.points, self.normals[1:]
            ),
            "points: coordinates span": lambda: cfreg.PointCloud(self.points * 1e20),
        }.items():
            with self.subTest(name), self.assertRaisesRegex(ValueError, f"^{name}"):
                call()

    def test_a_cloud_is_as_good_as_its_array(self):
        cloud = cfreg.PointCloud(self.points)
        np.testing.assert_array_equal(cfreg.fpfh(cloud, 30), cfreg.fpfh(self.points, 30))
        seen = cfreg.PointCloud(self.points, viewpoint=(0, 0, -9))
        np.testing.assert_array_equal(
            cfreg.fpfh(seen, 30), cfreg.fpfh(self.points, 30, viewpoint=(0, 0, -9))
        )


class Interop(unittest.TestCase):
    """Clouds of other libraries: taken, and given back."""

    def setUp(self):
        self.points = terrain(300)
        self.normals = self.points / np.linalg.norm(self.points, axis=1, keepdims=True)
        self.found = cfreg.register(self.points, turned(self.points)[0], "cf", neighbors=60)
        self.moved = cfreg.PointCloud(self.points).transformed(self.found.transform).points

    def taken(self, cloud, normals=True):
        read = cfreg.PointCloud(cloud)
        np.testing.assert_allclose(read.points, self.points, atol=1e-6)
        if normals:
            np.testing.assert_allclose(read.normals, self.normals, atol=1e-6)
        else:
            self.assertIsNone(read.normals)
        np.testing.assert_array_equal(cfreg.fpfh(cloud, 30), cfreg.fpfh(read, 30))

    def returned(self, cloud, positions):
        before = np.array(positions(cloud))
        moved = self.found.apply(cloud)
        self.assertIs(type(moved), type(cloud))
        np.testing.assert_allclose(positions(moved), self.moved, atol=1e-6)
        np.testing.assert_array_equal(positions(cloud), before, "the cloud given stays as it was")

    def test_arrays(self):
        for dtype in (np.float32, np.float64):
            moved = self.found.apply(self.points.astype(dtype))
            self.assertEqual(moved.dtype, dtype)
            np.testing.assert_allclose(moved, self.moved, atol=1e-6)
        for wrong in (self.points[:, :2], self.points[0]):
            with self.assertRaisesRegex(cfreg.ShapeError, "^cloud: expected shape"):
                self.found.apply(wrong)
        whole = self.found.apply(np.array([[1, 2, 3]]))
        np.testing.assert_allclose(whole, self.found.apply(np.array([[1.0, 2.0, 3.0]])))

    @unittest.skipUnless(open3d, "Open3D is not installed")
    def test_open3d(self):
        cloud = cfreg.PointCloud(self.points, self.normals).to_open3d()
        self.taken(cloud)
        self.returned(cloud, lambda cloud: np.asarray(cloud.points))
        tensors = open3d.t.geometry.PointCloud.from_legacy(cloud)
        self.taken(tensors)
        self.returned(tensors, lambda cloud: cloud.point.positions.numpy())
        self.taken(open3d.geometry.PointCloud(cloud.points), normals=False)
        # Bare vectors and tensors are arrays.
        self.taken(cloud.points, normals=False)
        self.taken(open3d.core.Tensor(self.points), normals=False)
        self.assertEqual(len(cfreg.PointCloud(open3d.t.geometry.PointCloud())), 0)
        ball = open3d.geometry.TriangleMesh.create_sphere()
        for mesh in (ball, open3d.t.geometry.TriangleMesh.from_legacy(ball)):
            self.assertIsNone(cfreg.PointCloud(mesh).normals)
            self.assertIs(type(self.found.apply(mesh)), type(mesh))
        # The pose is taken as it is.
        target = self.found.apply(cloud)
        measured = open3d.pipelines.registration.evaluate_registration(
            cloud, target, 0.01, self.found.transform
        )
        self.assertEqual(measured.fitness, 1.0)

    @unittest.skipUnless(small_gicp, "small_gicp is not installed")
    def test_small_gicp(self):
        cloud = cfreg.PointCloud(self.points).to_small_gicp()
        self.taken(cloud, normals=False)
        self.returned(cloud, lambda cloud: cloud.points()[:, :3])
        target = self.points @ self.found.rotation.T + self.found.translation
        aligned = small_gicp.align(target, self.points, init_T_target_source=self.found.transform)
        np.testing.assert_allclose(aligned.T_target_source, self.found.transform, atol=1e-3)

    @unittest.skipUnless(kiss_matcher, "KISS-Matcher is not installed")
    def test_kiss_matcher(self):
        source, target = terrain(4000, seed=1), turned(terrain(4000, seed=2))[0]
        clouds = [cfreg.PointCloud(points) for points in (source, target)]
        matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(0.05))
        theirs = matcher.estimate(*(list(cloud.points) for cloud in clouds))
        start = np.eye(4)
        start[:3, :3], start[:3, 3] = theirs.rotation, theirs.translation
        found = cfreg.ICP.generalized().register(*clouds, initial=start)
        np.testing.assert_allclose(found.transform, turned(source)[1], atol=0.02)

    @unittest.skipUnless(trimesh, "trimesh is not installed")
    def test_trimesh(self):
        cloud = cfreg.PointCloud(self.points).to_trimesh()
        self.taken(cloud, normals=False)
        self.returned(cloud, lambda cloud: cloud.vertices)
        ball = trimesh.creation.icosphere(subdivisions=3)
        read = cfreg.PointCloud(ball)
        np.testing.assert_allclose(read.normals, ball.vertices, atol=1e-2)

    @unittest.skipUnless(pyvista, "pyvista is not installed")
    def test_pyvista(self):
        cloud = cfreg.PointCloud(self.points, self.normals).to_pyvista()
        self.taken(cloud)
        self.returned(cloud, lambda cloud: np.asarray(cloud.points))

    def furnished(self, offset):
        """A cloud that has all that a cloud can have."""
        rng = np.random.default_rng(4)
        colors = rng.integers(0, 256, (300, 3)) / 255
        channels = dict(zip(("red", "green", "blue"), colors.T)) | {"intensity": rng.random(300)}
        weights = rng.random(300)
        return cfreg.PointCloud(self.points + offset, self.normals, weights=weights, channels=channels)

    def test_all_that_a_target_holds_goes_there_and_back(self):
        """Also far from zero, where points are float64 and the arrays handed out are read-only."""
        targets = {
            "open3d": (open3d, ("normals", "colors")),
            "pyvista": (pyvista, ("normals", "colors", "weights", "intensity")),
            "trimesh": (trimesh, ("colors",)),
            "small_gicp": (small_gicp, ()),
        }
        for name, (library, holds) in targets.items():
            for offset in (0.0, np.array([5e5, 5.6e6, 300.0])):
                if library is None:
                    print(f"skipped: {name} is not installed")
                    continue
                with self.subTest(name, offset=offset):
                    cloud = self.furnished(offset)
                    made = getattr(cloud, f"to_{name}")()
                    again = cfreg.PointCloud(made)
                    np.testing.assert_allclose(again.points, cloud.points, rtol=0, atol=1e-6)
                    np.testing.assert_array_equal(cloud.points, self.furnished(offset).points)
                    if "normals" in holds:
                        np.testing.assert_allclose(again.normals, cloud.normals, atol=1e-6)
                    if "colors" in holds:
                        for color in ("red", "green", "blue"):
                            np.testing.assert_allclose(again.channels[color], cloud.channels[color], atol=1e-6)
                    if "weights" in holds:
                        np.testing.assert_array_equal(again.weights, cloud.weights)
                    if "intensity" in holds:
                        np.testing.assert_array_equal(again.channels["intensity"], cloud.channels["intensity"])
                    # And moved by a pose, with its normals.
                    moved = cfreg.PointCloud(self.found.apply(made))
                    expected = cloud.transformed(self.found)
                    np.testing.assert_allclose(moved.points, expected.points, rtol=0, atol=1e-6)
                    if "normals" in holds:
                        np.testing.assert_allclose(moved.normals, expected.normals, atol=1e-6)

    @unittest.skipUnless(pyvista, "pyvista is not installed")
    def test_normals_of_pyvista_turn_whether_they_are_active_or_not(self):
        for active in (True, False):
            mesh = pyvista.PolyData(self.points)
            mesh.point_data["Normals"] = self.normals
            if active:
                mesh.point_data.active_normals_name = "Normals"
            moved = self.found.apply(mesh)
            np.testing.assert_allclose(moved.point_data["Normals"], self.normals @ self.found.rotation.T, atol=1e-6)
            np.testing.assert_array_equal(mesh.point_data["Normals"], self.normals)

    @unittest.skipUnless(pyvista, "pyvista is not installed")
    def test_columns_that_no_cloud_can_have_are_left_out(self):
        mesh = pyvista.PolyData(self.points)
        mesh.point_data["weight"] = np.full(300, -1.0)
        mesh.point_data["gap"] = np.where(np.arange(300) == 3, np.nan, 1.0)
        mesh.point_data["id"] = np.arange(300)
        cloud = cfreg.PointCloud(mesh)
        self.assertIsNone(cloud.weights)
        self.assertEqual(list(cloud.channels), ["id"])
        # A gap in a row that is left out is none.
        mesh.points[3, 0] = np.nan
        self.assertEqual(sorted(cfreg.PointCloud(mesh).channels), ["gap", "id"])

    @unittest.skipUnless(open3d, "Open3D is not installed")
    def test_tensors_of_open3d_have_columns(self):
        tensors = open3d.t.geometry.PointCloud(open3d.core.Tensor(self.points))
        tensors.point.intensity = open3d.core.Tensor(np.arange(300.0).reshape(-1, 1))
        tensors.point.weight = open3d.core.Tensor(np.arange(1.0, 301.0).reshape(-1, 1))
        tensors.point.colors = open3d.core.Tensor(np.full((300, 3), 255, np.uint8))
        cloud = cfreg.PointCloud(tensors)
        self.assertEqual(cloud.channels["intensity"].tolist(), list(range(300)))
        self.assertEqual(cloud.channels["green"].tolist(), [1.0] * 300)
        self.assertEqual(cloud.weights.tolist(), list(range(1, 301)))

    def test_a_path_is_read_and_moved(self):
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "scan.ply")
            cfreg.write(file, cfreg.PointCloud(self.points, self.normals))
            for path in (file, Path(file)):
                moved = self.found.apply(path)
                self.assertIsInstance(moved, cfreg.PointCloud)
                self.assertEqual(moved, cfreg.read(file).transformed(self.found))
            with self.assertRaises(FileNotFoundError):
                self.found.apply(os.path.join(folder, "absent.ply"))

    def test_data_frames(self):
        """Their columns are attributes, whatever they are called."""
        class Frame:
            def __init__(self, rows):
                self.vertices = self.normals = rows[:, 0]
                self.rows = rows

            def __dataframe__(self):
                raise NotImplementedError

            def __array__(self, dtype=None, copy=None):
                return self.rows

        self.assertEqual(cfreg.PointCloud(Frame(self.points)), cfreg.PointCloud(self.points))
        np.testing.assert_allclose(self.found.apply(Frame(self.points)), self.moved, atol=1e-6)

    def test_what_only_looks_like_one_is_refused(self):
        for odd in (SimpleNamespace(points=3), SimpleNamespace(vertices=None), [0.0, 0.0, 0.0]):
            with self.assertRaisesRegex(cfreg.Error, "^points"):
                cfreg.PointCloud(odd)


if __name__ == "__main__":
    unittest.main()
