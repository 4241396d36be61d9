"""The extension module, as a user of it: `python -m unittest discover tests/python`.

Needs the module installed (`pip install .`) and numpy; the numbers themselves are
compared with other implementations by python-ref/compare.py.
"""

import inspect
import threading
import traceback
import unittest
from pathlib import Path

import cfreg
import numpy as np


def terrain(count, seed=0):
    """Points (count, 3) on a surface without symmetry, float64."""
    x, y = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, count))
    z = 0.4 * np.sin(3.0 * x + y) + 0.3 * np.cos(2.0 * y - x * y) + 0.2 * x * x - 2.0
    return np.column_stack([x, y, z])


def turned(points):
    """The points a quarter turn about z, and the (4, 4) matrix that did it."""
    matrix = np.eye(4)
    matrix[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    return points @ matrix[:3, :3].T, matrix


class Readme(unittest.TestCase):
    def test_its_example_runs(self):
        readme = Path(__file__).resolve().parents[2] / "README.md"
        example = readme.read_text().split("```python\n")[1].split("```")[0]
        target, matrix = turned(terrain(700))
        names = {"source": terrain(700, seed=1), "target": target}
        exec(example, names)
        for pose in (names["found"]["transform"], names["pose"]):
            self.assertLess(np.linalg.norm(np.asarray(pose) - matrix), 0.5)


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

    def test_other_types_are_refused_by_name(self):
        for wrong in (
            self.points.tolist(),
            self.points.astype(int),
            self.points.astype(">f8"),
            self.points.astype(np.float16),
            self.points.astype(complex),
            None,
        ):
            with self.assertRaisesRegex(TypeError, "^target_points must be"):
                cfreg.register(self.points, wrong)

    def test_other_shapes_are_refused_by_name(self):
        for shape in ((12,), (4, 4), (0,), (2, 3, 1), ()):
            with self.assertRaisesRegex(ValueError, r"^points: expected shape \(N, 3\), found"):
                cfreg.estimate_normals(np.zeros(shape))


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
        with self.assertRaisesRegex(TypeError, "^values"):
            cfreg.keypoints(points, values=[0.0] * len(points))

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
            "target_descriptors": lambda: cfreg.moments(p, p, d, huge),
            "target_descriptors.*300.*299": lambda: cfreg.moments(p, p, d, d[1:]),
            "source_descriptors: ": lambda: cfreg.moments(p, p, d[:, :0], d),
            "columns of target_descriptors": lambda: cfreg.moments(p, p, d, d[:, 1:]),
            "weights": lambda: self.weigh(weights="gauss"),
            "beta": lambda: self.weigh(beta=0.0),
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

    def test_threads_change_no_bit(self):
        for normalize in ("none", "both", "sinkhorn:3"):
            found = [self.weigh(beta=10.0, normalize=normalize, threads=n) for n in (1, 2, 3)]
            for other in found[1:]:
                np.testing.assert_array_equal(found[0].cross, other.cross)
                self.assertEqual(found[0].weight, other.weight)

    def test_repr_is_one_readable_line(self):
        self.assertRegex(repr(self.moments), r"^Moments\(weight=\d+\.\d+, effective.*\)$")


class Register(unittest.TestCase):
    def setUp(self):
        self.source = terrain(1500, seed=1)
        self.target, self.truth = turned(terrain(1500, seed=2))

    def test_the_pose_is_found_and_accounted_for(self):
        self.source[4] = np.nan
        found = cfreg.register(self.source, self.target)
        np.testing.assert_allclose(found["transform"], self.truth, atol=0.1)
        self.assertIs(found["trusted"], not found["doubts"])
        self.assertEqual(found["points"]["source"]["dropped"], 1)
        self.assertEqual(found["points"]["target"]["used"], 1500)
        self.assertGreater(found["evaluation"]["fitness"], 0.8)
        self.assertEqual(found["config"]["beta"], 100.0)

    def test_numpy_scalars_are_settings_and_faults_name_theirs(self):
        found = cfreg.register(
            self.source, self.source, "icp", max_iterations=np.int64(3), refine="gicp"
        )
        self.assertEqual(found["method"], "gicp")
        self.assertEqual(found["refined_from"]["config"]["max_iterations"], 3)
        for wrong in (float("nan"), object()):
            with self.assertRaisesRegex((TypeError, ValueError), "max_distance"):
                cfreg.register(self.source, self.target, "icp", max_distance=wrong)

    def test_its_stages_give_the_same_pose(self):
        features = [cfreg.fpfh(points) for points in (self.source, self.target)]
        moments = cfreg.moments(self.source, self.target, *features)
        found = cfreg.register(self.source, self.target)
        np.testing.assert_array_equal(cfreg.solve(moments), found["transform"])
        self.assertEqual(moments.weight, found["moments"]["weight"])

    def test_settings_arrive(self):
        settings = {
            "neighbors": 40,
            "beta": 50.0,
            "weights": "student-t:3",
            "normalize": "both",
            "solver": "walker",
            "scale": "symmetric",
            "histogram": "open3d",
            "viewpoint": (0.0, 0.0, 5.0),
            "threads": 2,
        }
        config = cfreg.register(self.source, self.target, **settings)["config"]
        self.assertEqual(config.pop("neighborhood"), {"nearest": settings.pop("neighbors")})
        self.assertEqual(config.pop("normalization"), settings.pop("normalize"))
        self.assertEqual(config.pop("orientation"), {"towards": list(settings.pop("viewpoint"))})
        self.assertEqual({name: config[name] for name in settings}, settings)

    def test_descriptors_of_several_sizes_stand_beside_each_other(self):
        found = cfreg.register(
            self.source, self.target, neighbors=40, more_neighbors=[80, "160:50"], normal_neighbors=15, beta="auto"
        )
        self.assertEqual(
            found["config"]["more_scales"],
            [
                {"neighborhood": {"nearest": 80}, "normal_neighborhood": None},
                {"neighborhood": {"nearest": 160}, "normal_neighborhood": {"nearest": 50}},
            ],
        )
        self.assertEqual(found["config"]["beta"], "auto")
        self.assertGreater(found["beta"], 0.0)

    def test_signatures_state_the_defaults_of_the_crate(self):
        """None means the crate's own: the same configuration must come of both."""
        names = inspect.signature(cfreg.register).parameters
        own = ("source_points", "target_points", "method", "settings")
        unset = {name: None for name in names if name not in own}
        stated = cfreg.register(self.source, self.target)
        self.assertEqual(cfreg.register(self.source, self.target, **unset)["config"], stated["config"])
        for function in (cfreg.estimate_normals, cfreg.fpfh, cfreg.moments, cfreg.solve):
            for name, parameter in inspect.signature(function).parameters.items():
                if name == "scale" and function is cfreg.fpfh:
                    name = "histogram"
                if parameter.default not in (parameter.empty, None) and name in names:
                    given = {name: parameter.default}
                    found = cfreg.register(self.source, self.target, **given)["config"]
                    self.assertEqual(found, stated["config"], f"{function}: {name}")

    def test_any_method_and_refinement_by_name(self):
        found = cfreg.register(self.source, self.target, refine=["icp"], normalize="both")
        self.assertEqual((found["method"], found["refined_from"]["method"]), ("icp", "cf"))
        np.testing.assert_allclose(found["transform"], self.truth, atol=0.05)
        near = cfreg.register(self.target, self.target, method="icp", max_iterations=7)
        self.assertEqual(near["config"]["max_iterations"], 7)
        for wrong in ({"beta": 3.0}, {"sigma_x": 1}, {"max_iterations": "many"}):
            name = next(iter(wrong))
            with self.subTest(name), self.assertRaisesRegex(ValueError, f"^{name} = "):
                cfreg.register(self.source, self.target, method="icp", **wrong)
        with self.assertRaisesRegex(ValueError, "^refine = cf: "):
            cfreg.register(self.source, self.target, refine=["cf"])

    def test_arguments_are_refused_by_name(self):
        for argument, wrong in {
            "method": "x",
            "neighbors": 1,
            "beta": -1.0,
            "weights": "x",
            "normalize": "x",
            "solver": "x",
            "scale": "none",
            "histogram": "x",
            "viewpoint": (0.0, np.nan, 0.0),
        }.items():
            with self.subTest(argument), self.assertRaisesRegex(ValueError, f"^{argument} = "):
                cfreg.register(self.source, self.target, **{argument: wrong})
        for argument in ("neighbors", "beta", "weights", "viewpoint", "threads"):
            with self.subTest(argument), self.assertRaises(TypeError) as caught:
                cfreg.register(self.source, self.target, **{argument: object()})
            # From 3.11 on the name is a note, which tracebacks print.
            shown = "".join(traceback.format_exception(caught.exception))
            self.assertIn(f"'{argument}'", shown)
        for argument in ("neighbors", "threads"):
            with self.subTest(argument), self.assertRaisesRegex(ValueError, f"^{argument} = -1"):
                cfreg.register(self.source, self.target, **{argument: -1})

    def test_too_few_points_are_an_error(self):
        with self.assertRaisesRegex(cfreg.RegistrationError, "the target has 2 usable points"):
            cfreg.register(self.source, self.target[:2])

    def test_threads_change_no_bit(self):
        def pose(threads):
            return cfreg.register(self.source, self.target, threads=threads)["transform"]

        self.assertEqual(pose(1), pose(3))
        self.assertEqual(pose(1), pose(0))

    def test_other_threads_go_on(self):
        points = terrain(6000)
        descriptors = cfreg.fpfh(points, neighbors=20)
        calls = {
            "estimate_normals": lambda: cfreg.estimate_normals(points),
            "keypoints": lambda: cfreg.keypoints(points),
            "fpfh": lambda: cfreg.fpfh(points),
            "moments": lambda: cfreg.moments(
                points, points, descriptors, descriptors, normalize="sinkhorn:4", threads=1
            ),
            "register": lambda: cfreg.register(points, points, threads=1),
        }
        for name, call in calls.items():
            with self.subTest(name):
                self.assertGreater(steps_during(call), 5)


def steps_during(call):
    """How often this thread gets its turn, every millisecond at most, while another
    thread runs `call`: no more than once or twice where that one keeps the interpreter."""
    done = threading.Event()

    def work():
        call()
        done.set()

    worker = threading.Thread(target=work)
    worker.start()
    steps = 0
    while not done.wait(0.001):
        steps += 1
    worker.join()
    return steps


if __name__ == "__main__":
    unittest.main()
