"""A method of one's own, and correspondences from elsewhere."""

import tempfile
import unittest
from pathlib import Path

import cfreg
import numpy as np
from shapes import terrain, turned


class Centroids:
    """Moves centroid onto centroid, and turns by what it was told."""

    name = "centroids"

    def __init__(self, rotation):
        self.rotation = np.asarray(rotation)
        self.settings = {"rotation": self.rotation.tolist()}

    def register(self, source, target):
        pose = np.eye(4)
        pose[:3, :3] = self.rotation
        pose[:3, 3] = np.mean(target, axis=0) - self.rotation @ np.mean(source, axis=0)
        return pose


class CustomMethod(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.source, (cls.target, cls.truth) = terrain(1200, seed=1), turned(terrain(1200, seed=2))
        cls.mine = Centroids(cls.truth[:3, :3])

    def test_it_is_evaluated_verified_and_recorded(self):
        found = cfreg.register(self.source, self.target, self.mine, refine="icp")
        self.assertEqual((found.method, found.refined_from.method), ("icp", "centroids"))
        self.assertEqual(found.refined_from.config["rotation"], self.mine.settings["rotation"])
        self.assertEqual(found.verdict.decision, "accept", found.verdict)
        np.testing.assert_allclose(found.transform, self.truth, atol=0.1)

    def test_a_wrong_pose_is_not_accepted(self):
        found = cfreg.register(self.source, self.target, Centroids(np.eye(3)))
        self.assertNotEqual(found.verdict.decision, "accept")
        self.assertFalse(found.trusted)
        self.assertIsNone(cfreg.register(self.source, self.target, self.mine, verdict=False).verdict)

    def test_it_has_a_page(self):
        found = cfreg.register(self.source, self.target, self.mine)
        with tempfile.TemporaryDirectory() as folder:
            page = Path(folder) / "page.html"
            found.report(page)
            self.assertIn("centroids", page.read_text(encoding="utf-8"))

    def test_files_are_read_for_it(self):
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / name for name in ("source.ply", "target.ply")]
            for path, cloud in zip(paths, (self.source, self.target)):
                cfreg.write(path, cfreg.PointCloud(cloud))
            found = cfreg.register(*paths, self.mine)
        alone = cfreg.register(self.source, self.target, self.mine)
        np.testing.assert_allclose(found.transform, alone.transform, atol=1e-5)

    def test_what_is_no_pose_is_refused(self):
        class Broken:
            def register(self, source, target):
                return np.zeros((3, 3))

        with self.assertRaisesRegex(cfreg.Error, "the pose of the method"):
            cfreg.register(self.source, self.target, Broken())
        with self.assertRaisesRegex(cfreg.SettingError, "initial: a method of your own takes none"):
            cfreg.register(self.source, self.target, self.mine, initial=np.eye(4))
        with self.assertRaisesRegex(TypeError, "method"):
            cfreg.register(self.source, self.target, object())
        with self.assertRaisesRegex(TypeError, r"the class Broken: make an object, Broken\(\)"):
            cfreg.register(self.source, self.target, Broken)


    def test_it_runs_in_bulk(self):
        wrong = Centroids(np.eye(3))
        pairs = [(self.source, self.target), (self.source, self.source[:2])]
        found = cfreg.register_batch(pairs, self.mine, refine="icp")
        self.assertEqual(list(found["decision"]), ["accept", None])
        alone = cfreg.register(self.source, self.target, self.mine, refine="icp")
        np.testing.assert_allclose(found.transform[0], alone.transform, atol=1e-12)
        self.assertNotEqual(cfreg.register_batch(pairs[:1], wrong)["decision"][0], "accept")
        self.assertEqual(cfreg.register_batch(pairs[:1], self.mine, verdict=False)["decision"].tolist(), [None])
        with self.assertRaisesRegex(cfreg.SettingError, "seeds = 3: a method of your own takes none"):
            cfreg.register_batch(pairs, self.mine, seeds=3)

    def test_its_exceptions_are_errors_of_rows(self):
        class Fails:
            def register(self, source, target):
                if len(source) < 10:
                    raise LookupError("too small for me")
                return np.eye(4)

        pairs = [(self.source[:5], self.target), (self.source, self.source)]
        with tempfile.TemporaryDirectory() as folder:
            rows = Path(folder) / "rows.csv"
            done = cfreg.register_batch(pairs, Fails(), output=rows)
            self.assertEqual((done.pairs, done.errors), (2, 1))
            found = cfreg.read_batch(rows)
        self.assertIn("method = Fails: LookupError: too small for me", found["error"][0])
        self.assertEqual(found["decision"][1], "accept")


class GivenMatches(unittest.TestCase):
    def setUp(self):
        rng = np.random.default_rng(3)
        self.source = terrain(1500, seed=1)
        self.target, self.truth = turned(self.source)
        wrong = np.column_stack([rng.permutation(1500)[:200], rng.permutation(1500)[:200]])
        right = np.column_stack([np.arange(60), np.arange(60)])
        self.matches = np.concatenate([wrong, right])

    def test_consensus_finds_the_pose_that_they_agree_on(self):
        found = cfreg.register(self.source, self.target, matches=self.matches)
        self.assertEqual(found.verdict.decision, "accept", found.verdict)
        np.testing.assert_allclose(found.transform, self.truth, atol=0.05)
        scores = np.ones(len(self.matches))
        again = cfreg.register(self.source, self.target, matches=self.matches, scores=scores)
        np.testing.assert_array_equal(again.transform, found.transform)

    def test_scores_of_zero_leave_matches_out(self):
        scores = np.zeros(len(self.matches))
        with self.assertRaisesRegex(cfreg.TooFewPointsError, "the correspondences"):
            cfreg.register(self.source, self.target, matches=self.matches, scores=scores)
        scores[-60:] = 0.5
        found = cfreg.register(self.source, self.target, matches=self.matches, scores=scores)
        np.testing.assert_allclose(found.transform, self.truth, atol=0.05)

    def test_hostile_ones_are_refused(self):
        far = self.matches.copy()
        far[0, 1] = 99_999
        for arguments, words in [
            ({"matches": far}, "99999"),
            ({"matches": self.matches, "scores": [1.0, 2.0]}, "scores"),
            ({"matches": self.matches, "scores": np.full(len(self.matches), -1.0)}, "scores"),
            ({"scores": np.ones(3)}, "scores: only consensus takes them, with matches"),
        ]:
            with self.assertRaisesRegex(cfreg.Error, words):
                cfreg.register(self.source, self.target, **arguments)
        with self.assertRaisesRegex(cfreg.SettingError, "matches: cf takes none"):
            cfreg.register(self.source, self.target, "cf", matches=self.matches)


if __name__ == "__main__":
    unittest.main()
