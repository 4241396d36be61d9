"""Methods, by name and as objects, and what they are told."""

import dataclasses
import inspect
import json
import unittest

import cfreg
import numpy as np
from shapes import terrain, turned

GLOBAL = {"consensus": cfreg.Consensus, "cf": cfreg.CF, "cf-spectral": cfreg.CFSpectral, "cfk": cfreg.CFK, "teaser": cfreg.TEASER}
LOCAL = {"icp": cfreg.ICP, "kc": cfreg.KC, "cpd": cfreg.CPD, "dare": cfreg.DARE}


class Registering(unittest.TestCase):
    def setUp(self):
        self.source = terrain(1500, seed=1)
        self.target, self.truth = turned(terrain(1500, seed=2))

    def test_the_pose_is_found_and_accounted_for(self):
        self.source[4] = np.nan
        found = cfreg.register(self.source, self.target, "cf")
        np.testing.assert_allclose(found.transform, self.truth, atol=0.1)
        self.assertTrue(found.trusted)
        self.assertEqual(found.doubts, ())
        self.assertEqual(found.points["source"]["dropped"], 1)
        self.assertEqual(found.points["target"]["used"], 1500)
        self.assertGreater(found.evaluation.fitness, 0.8)
        self.assertEqual((found.beta, found.config["beta"]), (100.0, 100.0))

    def test_the_default_tells_how_probable_it_is(self):
        found = cfreg.register(self.source, self.target)
        self.assertEqual(found.method, "consensus")
        np.testing.assert_allclose(found.transform, self.truth, atol=0.02)
        verdict = found.verdict
        self.assertEqual((verdict.decision, found.trusted), ("accept", True))
        self.assertGreater(verdict.probability, 0.9)
        self.assertGreater(verdict.overlap, 0.8)
        self.assertTrue(all(isinstance(reason, str) for reason in verdict.reasons))
        self.assertIn("accept, right with probability", found._repr_html_())
        other = cfreg.register(self.source, terrain(1500, seed=9)[:, [0, 2, 1]] ** 2)
        self.assertEqual(other.verdict.decision, "reject")
        self.assertEqual([doubt.ground for doubt in other.doubts][:1], ["improbable"])
        self.assertIsNone(cfreg.register(self.source, self.target, "cf", verdict=False).verdict)

    def test_its_stages_give_the_same_pose(self):
        features = [cfreg.fpfh(points) for points in (self.source, self.target)]
        moments = cfreg.moments(self.source, self.target, *features)
        found = cfreg.register(self.source, self.target, "cf")
        np.testing.assert_array_equal(cfreg.solve(moments), found.transform)
        self.assertEqual(moments.weight, found.to_dict()["moments"]["weight"])

    def test_every_method_registers_by_name_and_as_an_object(self):
        near = self.truth.copy()
        near[:3, 3] = 0.02
        for name, made in (GLOBAL | LOCAL).items():
            with self.subTest(name):
                start = {} if name in GLOBAL else {"initial": near}
                found = made().register(self.source, self.target, **start)
                again = cfreg.register(self.source, self.target, name, **start)
                self.assertEqual((found.method, again.method), (name, name))
                np.testing.assert_array_equal(found.transform, again.transform)
                np.testing.assert_allclose(found.transform, self.truth, atol=0.12)
        self.assertEqual(set(cfreg.METHODS) - set(GLOBAL | LOCAL), {"cf-multiscale", "icp-paper", "plane-icp", "gicp"})

    def test_without_a_start_they_begin_where_the_clouds_lie(self):
        found = cfreg.register(self.source, self.source, "icp", initial=np.eye(4))
        np.testing.assert_array_equal(found.transform, cfreg.ICP().register(self.source, self.source).transform)

    def test_matches_of_ones_own_are_solved(self):
        target, truth = turned(self.source)
        right = np.column_stack([np.arange(100), np.arange(100)])
        wrong = np.random.default_rng(0).integers(0, 1500, (100, 2))
        matches = np.vstack([right, wrong])
        for found in (
            cfreg.TEASER(noise_bound=0.01).register(self.source, target, matches=matches),
            cfreg.register(self.source, target, "teaser", noise_bound=0.01, matches=matches),
        ):
            np.testing.assert_allclose(found.transform, truth, atol=1e-4)
            self.assertEqual(found.connections, 200)
        with self.assertRaisesRegex(cfreg.ShapeError, "points of the source, for a pair with its point 50: expected 51, found 50"):
            cfreg.TEASER().register(self.source[:50], target, matches=matches)

    def test_refinements_by_name_and_made(self):
        refine = ["icp", cfreg.ICP.plane(max_distance=0.3)]
        found = cfreg.register(self.source, self.target, "cf", refine=refine, normalize="both")
        self.assertEqual((found.method, found.config["max_distance"]), ("plane-icp", 0.3))
        before = found.refined_from
        self.assertEqual((before.method, before.refined_from.method), ("icp", "cf"))
        np.testing.assert_allclose(found.transform, self.truth, atol=0.02)
        # Pairs of any length, as after "cf".
        alone = cfreg.ICP(max_distance=1e3)
        alone = alone.register(self.source, self.target, initial=before.refined_from.transform)
        np.testing.assert_array_equal(before.transform, alone.transform)
        for wrong in ("cf", cfreg.CF(), ["icp", "cfk"]):
            with self.assertRaisesRegex(cfreg.SettingError, "^refine = cfk?: "):
                cfreg.register(self.source, self.target, refine=wrong)
        plain = cfreg.register(self.source, self.target, refine=None)
        self.assertIsNone(plain.refined_from)
        for wrong in (3, [None], cfreg.ICP):
            with self.assertRaisesRegex(TypeError, "^refine: a method or its name"):
                cfreg.register(self.source, self.target, refine=wrong)
        with self.assertRaisesRegex(cfreg.SettingError, "^refine = icq"):
            cfreg.register(self.source, self.target, refine="icq")

    def test_what_cannot_be_solved_is_its_own_error(self):
        with self.assertRaisesRegex(cfreg.TooFewPointsError, "the target has 2 usable points"):
            cfreg.register(self.source, self.target[:2])
        for empty in (np.zeros((0, 3)), np.full((9, 3), np.nan), cfreg.PointCloud(np.zeros((0, 3)))):
            with self.assertRaisesRegex(cfreg.TooFewPointsError, "the source has 0 usable points"):
                cfreg.register(empty, self.target)
        line = np.outer(np.arange(300.0), [1.0, 2.0, 3.0])
        with self.assertRaises(cfreg.DegenerateError):
            cfreg.register(line, line)
        for error in (cfreg.TooFewPointsError, cfreg.DegenerateError, cfreg.NoWeightError):
            self.assertTrue(issubclass(error, cfreg.RegistrationError))
        for name in cfreg.__all__:
            if name.endswith("Error") and name not in ("Error", "PoseError"):
                self.assertTrue(issubclass(getattr(cfreg, name), cfreg.Error), name)
                self.assertTrue(issubclass(getattr(cfreg, name), ValueError), name)

    def test_threads_change_no_bit(self):
        poses = [cfreg.register(self.source, self.target, threads=n).transform for n in (1, 3, 0)]
        np.testing.assert_array_equal(poses[0], poses[1])
        np.testing.assert_array_equal(poses[0], poses[2])


class Settings(unittest.TestCase):
    def setUp(self):
        self.source = terrain(400, seed=1)
        self.target, _ = turned(terrain(400, seed=2))

    def test_classes_state_the_defaults_of_the_crate(self):
        """The same configuration must come of a class and of its name alone."""
        for name, make in cfreg.METHODS.items():
            with self.subTest(name):
                stated = make()
                kind = type(stated)
                for field in dataclasses.fields(kind):
                    self.assertIsNot(field.default, dataclasses.MISSING)
                    self.assertIn(field.name, inspect.signature(kind).parameters)
                plain = cfreg._native.settings(name, "{}")
                self.assertEqual(stated.settings(), json.loads(plain))

    def test_stages_state_the_same_defaults(self):
        for function in (cfreg.estimate_normals, cfreg.fpfh, cfreg.moments, cfreg.solve):
            for name, parameter in inspect.signature(function).parameters.items():
                if name == "scale" and function is cfreg.fpfh:
                    name = "histogram"
                if parameter.default not in (parameter.empty, None) and name in cfreg.CF.__dataclass_fields__:
                    default = cfreg.CF.__dataclass_fields__[name].default
                    self.assertEqual(parameter.default, default, f"{function.__name__}: {name}")

    def test_settings_arrive(self):
        settings = {
            "neighbors": 40,
            "beta": 50.0,
            "weights": "student-t:3",
            "normalize": "both",
            "solver": "walker",
            "scale": "symmetric",
            "histogram": "open3d",
            "orientation": (0.0, 0.0, 5.0),
            "threads": 2,
        }
        config = cfreg.register(self.source, self.target, "cf", **settings).config
        self.assertEqual(config, cfreg.CF(**settings).register(self.source, self.target).config)
        self.assertEqual(config.pop("neighborhood"), {"nearest": settings.pop("neighbors")})
        self.assertEqual(config.pop("normalization"), settings.pop("normalize"))
        self.assertEqual(config.pop("orientation"), {"towards": list(settings.pop("orientation"))})
        self.assertEqual({name: config[name] for name in settings}, settings)
        self.assertEqual(cfreg.CF(radius=0.5).settings()["neighborhood"], {"radius": 0.5})
        self.assertEqual(cfreg.CF(orientation="outward").settings()["orientation"], "outward")
        iss = cfreg.CFK(detector={"iss": {"gamma21": 0.9}}).settings()["keypoints"]["iss"]
        self.assertEqual(iss["gamma21"], 0.9)

    def test_descriptors_of_several_sizes_stand_beside_each_other(self):
        found = cfreg.register(
            self.source, self.target, "cf", neighbors=40, more_neighbors=[80, "160:50"], normal_neighbors=15, beta="auto"
        )
        self.assertEqual(
            found.config["more_scales"],
            [
                {"neighborhood": {"nearest": 80}, "normal_neighborhood": None},
                {"neighborhood": {"nearest": 160}, "normal_neighborhood": {"nearest": 50}},
            ],
        )
        self.assertEqual(found.config["beta"], "auto")
        self.assertGreater(found.beta, 0.0)

    def test_presets_can_be_altered(self):
        self.assertIsNone(cfreg.CF.multiscale(weights=cfreg.weights.Gaussian("auto")).beta)
        sharp = cfreg.CF.multiscale(normalize="none")
        self.assertEqual((sharp.normalize, sharp.beta), ("none", "auto"))
        self.assertEqual(cfreg.method("gicp", max_iterations=7).settings()["max_iterations"], 7)
        other = dataclasses.replace(sharp, beta=3.0)
        self.assertEqual((other.beta, sharp.beta), (3.0, "auto"))
        with self.assertRaises(dataclasses.FrozenInstanceError):
            sharp.beta = 4.0

    def test_they_tell_what_differs_from_the_defaults(self):
        self.assertEqual(repr(cfreg.CF()), "CF()")
        self.assertEqual(repr(cfreg.ICP.plane(max_distance=0.1)), "ICP(metric='plane', max_distance=0.1)")
        for method in (cfreg.CF.multiscale(), cfreg.TEASER(noise_bound=0.1), cfreg.DARE(components=9)):
            self.assertEqual(eval(repr(method), vars(cfreg)), method)

    def test_numpy_scalars_are_settings_and_arrays_are_viewpoints(self):
        self.assertEqual(cfreg.ICP(max_iterations=np.int64(3)).settings()["max_iterations"], 3)
        self.assertEqual(cfreg.KC(sigma=np.float32(0.5)).settings()["sigma"], 0.5)
        at = cfreg.CF(orientation=np.array([0.0, 1.0, 2.0])).settings()["orientation"]
        self.assertEqual(at, {"towards": [0.0, 1.0, 2.0]})
        one, other = (
            cfreg.CF(orientation=kind([0.0, 1.0, 2.0]), more_neighbors=kind([200, 400])) for kind in (np.array, list)
        )
        self.assertEqual((one, hash(one)), (other, hash(other)))

    def test_values_are_refused_when_the_method_is_made(self):
        for name, settings in {
            "neighbors": [
                {"neighbors": 1},
                {"neighbors": "x"},
                {"neighbors": -1},
                {"neighbors": 2.5},
                {"neighbors": 10, "radius": 0.1},
            ],
            "beta": [{"beta": -1.0}, {"beta": np.nan}, {"beta": "x"}],
            "weights": [{"weights": "x"}],
            "normalize": [{"normalize": "x"}],
            "solver": [{"solver": "x"}],
            "scale": [{"scale": "none"}],
            "histogram": [{"histogram": "x"}],
            "viewpoint": [{"orientation": (0.0, np.nan, 0.0)}],
            "orientation": [{"orientation": "up"}, {"orientation": (0.0, 1.0)}, {"orientation": 5}],
            "normal_neighbors": [{"normal_neighbors": 1}],
            "more_neighbors": [{"more_neighbors": [2]}],
            "threads": [{"threads": -1}, {"threads": 100_000}],
            "tolerance": [{"tolerance": -0.1}, {"tolerance": 1.0}, {"tolerance": np.nan}],
            "radius": [{"radius": 0.0}],
        }.items():
            for wrong in settings:
                with self.subTest(repr(wrong)), self.assertRaisesRegex(cfreg.SettingError, f"^{name} = "):
                    cfreg.CF(**wrong)
        for make, name in (
            (lambda: cfreg.ICP(keep=1.5), "keep"),
            (lambda: cfreg.ICP(max_distance=np.inf), "max_distance"),
            (lambda: cfreg.KC(factor=2.0), "factor"),
            (lambda: cfreg.CPD(outliers=1.0), "outliers"),
            (lambda: cfreg.DARE(max_iterations=0), "max_iterations"),
            (lambda: cfreg.TEASER(gnc_factor=1.0), "gnc_factor"),
            (lambda: cfreg.CFK(detector="harris"), "detector"),
            (lambda: cfreg.method("sift"), "method"),
        ):
            with self.subTest(name), self.assertRaisesRegex(cfreg.SettingError, f"^{name} = "):
                make()
        with self.assertRaisesRegex(TypeError, "^beta: object"):
            cfreg.CF(beta=object())

    def test_settings_of_other_methods_are_refused_by_name(self):
        def register(*method, **settings):
            return cfreg.register(self.source, self.target, *method, **settings)

        for name, call in {
            "sigma = 1: cf has no such setting; it has neighbors": lambda: register("cf", sigma=1),
            "beta = 3: icp has no such setting": lambda: register("icp", beta=3),
            "beta = 3: the method was made already": lambda: register(cfreg.CF(), beta=3),
            "initial: cf starts from no pose": lambda: register("cf", initial=np.eye(4)),
            "matches: icp takes none": lambda: register("icp", matches=[[0, 0]]),
            "refine = 33: refinements": lambda: register(refine=["icp"] * 33),
            "initial = ": lambda: register("icp", initial=np.zeros((4, 4))),
            "initial: must be a": lambda: register("icp", initial=np.eye(3)),
        }.items():
            with self.subTest(name), self.assertRaisesRegex(ValueError, f"^{name}"):
                call()
        with self.assertRaises(TypeError):
            cfreg.CF(sigma=1)
        for wrong, shown in ((3, "3"), (None, "None"), (cfreg.CF, "the class CF")):
            with self.assertRaisesRegex(TypeError, f"^method: a method or its name is needed, not {shown}"):
                register(wrong)


if __name__ == "__main__":
    unittest.main()
