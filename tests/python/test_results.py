"""Results: what they tell, and in which forms."""

import json
import math
import pickle
import tempfile
import unittest
from pathlib import Path

import cfreg
import numpy as np
from shapes import terrain, turned


class Registration(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        source, (target, cls.truth) = terrain(800, seed=1), turned(terrain(800, seed=2))
        cls.found = cfreg.register(source, target, "cf", refine="icp")
        cls.wrong = cfreg.register(source, np.random.default_rng(0).random((300, 3)), "cf", verdict=False)
        cls.refused = cfreg.register(source, np.random.default_rng(0).random((300, 3)))

    def test_the_pose_has_its_parts(self):
        found = self.found
        self.assertEqual((found.transform.shape, found.transform.dtype), ((4, 4), np.float64))
        self.assertFalse(found.transform.flags.writeable)
        np.testing.assert_allclose(found.rotation @ found.rotation.T, np.eye(3), atol=1e-12)
        self.assertAlmostEqual(found.scale, 1.0, places=12)
        self.assertAlmostEqual(found.angle_deg, 90.0, delta=1.0)
        np.testing.assert_array_equal(found.translation, found.transform[:3, 3])

    def test_a_scale_is_part_of_it(self):
        points = terrain(500)
        found = cfreg.register(points, 3.0 * points, "cf", scale="symmetric", neighbors=60)
        self.assertAlmostEqual(found.scale, 3.0, places=3)
        np.testing.assert_allclose(found.rotation, np.eye(3), atol=1e-3)
        np.testing.assert_allclose(found.apply(points), 3.0 * points, atol=1e-2)

    def test_a_verdict_refuses_what_has_nothing_in_common(self):
        verdict = self.refused.verdict
        self.assertEqual((verdict.decision, self.refused.trusted), ("reject", False))
        self.assertLess(verdict.probability, 0.5)
        self.assertEqual(self.refused.doubts[0].ground, "improbable")
        self.assertEqual(self.refused.doubts[0].facts["found"], verdict.probability)

    def test_every_method_is_judged_unless_told_off(self):
        source, target = terrain(800, seed=1), turned(terrain(800, seed=2))[0]
        for method in ("cf", "icp", "teaser"):
            found = cfreg.register(source, target, method)
            self.assertIsNotNone(found.verdict, method)
            self.assertEqual(found.trusted, found.verdict.decision == "accept", found.doubts)
            self.assertIsNone(cfreg.register(source, target, method, verdict=False).verdict)
        with self.assertRaisesRegex(cfreg.SettingError, "verdict = sometimes: must be on, off or auto"):
            cfreg.register(source, target, "cf", verdict="sometimes")
        pair = [(source, target)]
        self.assertIsNone(cfreg.register_batch(pair, "cf")[0]["decision"])
        self.assertIsNotNone(cfreg.register_batch(pair, "cf", verdict=True)[0]["decision"])

    def test_missing_returns_are_left_out_and_counted(self):
        source, target = terrain(800, seed=1), turned(terrain(800, seed=2))[0]
        zeros = np.zeros((300, 3))
        found = cfreg.register(np.vstack([source, zeros]), target)
        self.assertEqual(found.points["source"]["no_returns"], 300)
        np.testing.assert_allclose(found.transform, cfreg.register(source, target).transform, atol=1e-6)
        kept = cfreg.register(np.vstack([source, zeros]), target, "cf", keep_no_returns=True)
        self.assertEqual(kept.points["source"]["no_returns"], 0)

    def test_names_of_before_still_work_and_say_so(self):
        for old, new in [("judge", "verify"), ("Doubt", "PoseWarning"), ("TruthError", "PoseError"),
                         ("Judgement", "EvaluationReport")]:
            with self.assertWarnsRegex(DeprecationWarning, f"cfreg.{old} is now cfreg.{new}"):
                self.assertIs(getattr(cfreg, old), getattr(cfreg, new))
        with self.assertRaises(AttributeError):
            cfreg.nothing

    def test_names_that_visitors_type(self):
        found = self.found
        np.testing.assert_array_equal(found.transformation, found.transform)
        self.assertEqual((found.fitness, found.inlier_rmse), (found.evaluation.fitness, found.evaluation.inlier_rmse))
        self.assertEqual(found.probability, found.verdict.probability if found.verdict else None)
        self.assertEqual(found.doubts, found.warnings)
        np.testing.assert_allclose(found.inverse() @ found.transform, np.eye(4), atol=1e-12)

    def test_any_pose_is_judged(self):
        source, target = terrain(800, seed=1), turned(terrain(800, seed=2))[0]
        told = cfreg.verify(source, target, self.found)
        self.assertEqual(told.decision, "accept")
        self.assertGreater(told.probability, 0.9)
        told = cfreg.verify(source, target, np.eye(4), seeds=50)
        self.assertEqual(told.decision, "reject")
        np.testing.assert_allclose(told.runner_up.transform[:3, :3], self.truth[:3, :3], atol=0.1)
        with self.assertRaisesRegex(cfreg.SettingError, "seeds"):
            cfreg.verify(source, target, np.eye(4), seeds=0)
        with self.assertRaisesRegex(cfreg.SettingError, "method = 'cf': poses are verified by consensus"):
            cfreg.verify(source, target, np.eye(4), method="cf")

    def test_a_pose_that_was_refined_has_a_verdict(self):
        source, target = terrain(800, seed=1), turned(terrain(800, seed=2))[0]
        target = target[target[:, 0] > -0.3]
        for refine in (
            "icp",
            "gicp",
            # These leave the pose that they were given.
            cfreg.KC(sigma=3.0, last_sigma=2.0),
            cfreg.ICP(max_distance=5.0),
            [cfreg.KC(sigma=3.0, last_sigma=2.0), "icp"],
        ):
            found = cfreg.register(source, target, refine=refine)
            self.assertIsNotNone(found.verdict, f"after {refine}")
            if found.refined_from is None:
                # The pose before it was accepted, the refined one was not.
                self.assertEqual(found.verdict.decision, "accept")
                self.assertIn("was dropped", "; ".join(found.verdict.reasons))
                continue
            first = found.refined_from
            while first.refined_from is not None:
                first = first.refined_from
            self.assertIsNotNone(first.verdict)
            moved = found.transform @ np.linalg.inv(found.refined_from.transform)
            if np.linalg.norm(moved[:3, :3] - np.eye(3)) > 0.3:
                self.assertNotEqual(found.verdict.decision, "accept")

    def test_files_are_clouds(self):
        source, target = terrain(800, seed=1), turned(terrain(800, seed=2))[0]
        with tempfile.TemporaryDirectory() as folder:
            files = [Path(folder, "source.ply"), str(Path(folder, "target.pcd"))]
            for file, points in zip(files, (source, target)):
                cfreg.write(file, points)
            clouds = [cfreg.read(file) for file in files]
            found = cfreg.register(*files)
            np.testing.assert_array_equal(found.transform, cfreg.register(*clouds).transform)
            self.assertEqual(repr(cfreg.verify(*files, found)), repr(cfreg.verify(*clouds, found)))
            self.assertEqual(cfreg.evaluate(*files, found), cfreg.evaluate(*clouds, found))
            with self.assertRaises(FileNotFoundError):
                cfreg.verify(Path(folder, "none.ply"), target, found)

    def test_doubts_have_words_and_numbers(self):
        self.assertFalse(self.wrong.trusted)
        doubt = self.wrong.doubts[0]
        self.assertEqual(doubt.ground, "low-agreement")
        self.assertIn("barely better than chance", str(doubt))
        self.assertLess(doubt.facts["found"], doubt.facts["needed"])

    def test_it_is_json_and_back(self):
        for found in (self.found, self.wrong):
            facts = found.to_dict()
            self.assertEqual(json.loads(found.to_json()), facts)
            self.assertEqual(cfreg.Registration(facts), found)
            facts["config"]["method"] = "other"
            self.assertEqual(found.config["method"], found.method)
            self.assertEqual(pickle.loads(pickle.dumps(found)), found)
        self.assertNotEqual(self.found, self.wrong)

    def test_it_cannot_be_changed(self):
        for name in ("trusted", "transform", "mine"):
            with self.assertRaisesRegex(AttributeError, f"^{name}"):
                setattr(self.found, name, True)
        before = self.found.to_json()
        self.found.config["beta"] = self.found.seconds["total"] = 7
        self.assertEqual(self.found.to_json(), before)

    def test_a_doubt_names_the_viewpoint_that_nobody_knows(self):
        self.assertIn("no-viewpoint", [doubt.ground for doubt in self.wrong.doubts])
        noise = cfreg.PointCloud(np.random.default_rng(0).random((300, 3)), viewpoint=(0, 0, 9))
        known = cfreg.register(cfreg.PointCloud(terrain(300), viewpoint=(0, 0, 9)), noise, "cf", verdict=False)
        grounds = [doubt.ground for doubt in known.doubts]
        self.assertTrue("low-agreement" in grounds and "no-viewpoint" not in grounds, grounds)

    def test_the_same_again_is_equal_but_for_the_time(self):
        points = terrain(200)
        once, again = (cfreg.register(points, points, "cf", neighbors=40, refine="icp") for _ in range(2))
        self.assertNotEqual(once.seconds, again.seconds)
        self.assertEqual(once, again)
        self.assertNotEqual(once, once.refined_from)

    def test_it_tells_itself(self):
        self.assertRegex(
            repr(self.found),
            r"^Registration\(accept, probability [01]\.\d+, icp, rotation 9\d\.\d\d deg, "
            r"translation \[.*\], fitness 0\.\d+, .* s\)$",
        )
        self.assertIn("not trusted: low-agreement", repr(self.wrong))
        self.assertEqual(str(self.wrong).count("\n"), len(self.wrong.doubts))

    def test_notebooks_show_a_table(self):
        from xml.etree import ElementTree

        for found, verdict in ((self.found, "accept, right with probability 1.000"), (self.wrong, "has warnings")):
            table = ElementTree.fromstring(found._repr_html_())
            cells = [cell.text for cell in table.iter("td")]
            self.assertIn(verdict, cells)
            self.assertEqual(cells[-16:], [f"{x:.6g}" for x in found.transform.ravel()])

    def test_a_trace_and_a_certificate_where_asked(self):
        points = terrain(300)
        self.assertEqual(self.found.trace, [])
        trace = cfreg.ICP(trace=True).register(points, points + 0.01).trace
        self.assertEqual([step["iteration"] for step in trace], list(range(1, len(trace) + 1)))
        sure = cfreg.TEASER(certify=True, neighbors=40).register(points, points)
        self.assertLess(sure.certificate["gap"], 1.0)
        self.assertIsNone(self.found.certificate)


class Evaluation(unittest.TestCase):
    def test_it_is_that_of_the_registration(self):
        source, (target, truth) = terrain(500, seed=1), turned(terrain(500, seed=2))
        found = cfreg.register(source, target)
        judged = cfreg.evaluate(source, target, found.transform, truth=truth)
        for name, value in vars(found.evaluation).items():
            self.assertEqual(getattr(judged, name), value)
        self.assertEqual(cfreg.evaluate(source, target, found, truth=truth), judged)
        e = judged
        self.assertAlmostEqual(e.agreement, (e.fitness - e.chance) / (1.0 - e.chance))
        turn = found.rotation @ truth[:3, :3].T
        self.assertAlmostEqual(judged.truth.rotation_frobenius, np.linalg.norm(np.eye(3) - turn))
        angle = math.degrees(math.acos((np.trace(turn) - 1.0) / 2.0))
        self.assertAlmostEqual(judged.truth.rotation_deg, angle, places=4)
        self.assertLess(judged.truth.translation, 0.2)

    def test_nothing_near_is_no_number(self):
        far = np.eye(4)
        far[0, 3] = 1e6
        points = terrain(50)
        judged = cfreg.evaluate(points, points, far, max_distance=1.0)
        self.assertEqual(judged.fitness, 0.0)
        self.assertTrue(math.isnan(judged.inlier_rmse))
        self.assertIsNone(judged.truth)

    def test_arguments_are_refused_by_name(self):
        points = terrain(50)
        for name, call in {
            "transform": lambda: cfreg.evaluate(points, points, np.zeros((4, 4))),
            "truth": lambda: cfreg.evaluate(points, points, np.eye(4), truth=np.eye(3)),
            "max.distance": lambda: cfreg.evaluate(points, points, np.eye(4), -1.0),
            "source": lambda: cfreg.evaluate(points[:, :2], points, np.eye(4)),
        }.items():
            with self.subTest(name), self.assertRaisesRegex(ValueError, f"^{name}"):
                call()
        with self.assertRaisesRegex(cfreg.TooFewPointsError, "the target"):
            cfreg.evaluate(points, points[:0], np.eye(4))


if __name__ == "__main__":
    unittest.main()
