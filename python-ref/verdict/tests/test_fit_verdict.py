"""The verdict's fit on poses whose odds are known."""

import contextlib
import io
import json
import unittest

import numpy as np

from verdict import fit_verdict
from verdict.fit_verdict import (
    MODEL,
    Judge,
    Poses,
    calibration_error,
    cells,
    fit,
    held_out,
    model_of,
    place,
    source_judge,
)

EVIDENCE = {True: np.array([-2.0, 1.0, 2.0, 0.5, -6.0]), False: np.array([-1.0, 0.5, 1.5, 1.0, 0.0])}
TRUE = Judge(EVIDENCE, np.array([0.5, 1.0, 0.8, -0.4]))


def poses(count, seed=1):
    """Poses of two places and both kinds, right with the probability that `TRUE` tells."""
    rng = np.random.default_rng(seed)
    known = rng.uniform(size=count) < 0.5
    terms = np.column_stack([np.ones(count), rng.normal(size=(count, 3)), known * rng.uniform(size=count)])
    places = np.array([["attic", "attic"], ["cellar", "cellar"]])[np.arange(count) % 2]
    standing = rng.normal(size=(count, 2))
    drawn = Poses(terms, standing, known, np.zeros(count, bool), places[:, 0], places)
    drawn.right = rng.uniform(size=count) < TRUE.probabilities(drawn)
    return drawn


class Fit(unittest.TestCase):
    def test_the_constants_come_back(self):
        drawn = poses(40_000)
        judge = fit(drawn, drawn)
        slope = judge.answer[1]
        for kind in EVIDENCE:
            # One offset undoes the balance of both kinds, which is not the same.
            np.testing.assert_allclose(slope * judge.evidence[kind][1:], EVIDENCE[kind][1:], rtol=0.1, atol=0.1)
        # The offset that is left flattens the others.
        np.testing.assert_allclose(judge.answer[2:], TRUE.answer[2:], atol=0.1)

    def test_the_calibration_undoes_the_balance(self):
        """Weights that make right and wrong as many move the odds; the answers move them back."""
        drawn = poses(20_000)
        drawn = drawn.where(drawn.known)
        self.assertLess(np.mean(drawn.right), 0.4)
        judge = fit(drawn, drawn)
        self.assertLess(judge.answer[0], -0.5)
        self.assertLess(calibration_error(judge.probabilities(drawn), drawn.right), 0.02)

    def test_the_source_has_as_many_constants_as_there_are_terms(self):
        source = source_judge()
        self.assertEqual([len(source.evidence[known]) for known in (True, False)], [5, 5])
        self.assertLess(source.evidence[True][4], -10)
        self.assertGreater(source.evidence[False][3], 0)
        self.assertEqual(len(source.answer), 4)
        self.assertGreater(source.answer[2], 0)
        self.assertLess(source.answer[3], 0)


    def test_a_model_file_has_what_the_crate_reads(self):
        model = model_of(TRUE, "test", "made")
        crate = json.loads(MODEL.read_text())
        self.assertEqual(list(model), list(crate))
        for part in ("pose", "answer", "thresholds"):
            self.assertEqual(list(model[part]), list(crate[part]))
        self.assertEqual(model["pose"]["sensors_known"]["free_space_violation"], -6.0)
        self.assertEqual(model["answer"]["translation_std"], -0.4)


class Judged(unittest.TestCase):
    def test_scans_of_the_kitchen_are_one_place(self):
        files = ["x/rgbd_tsdf_fusion/a.ply", "y/7-scenes-redkitchen/b.ply", "rgbd_7scenes_frames/c.ply"]
        self.assertEqual({place(file) for file in files}, {"kitchen"})
        self.assertEqual(place("x/kitti00/1.ply"), "kitti00")

    def test_what_is_accepted_and_refused_is_counted(self):
        right = np.array([True, True, False, False, False])
        places = np.array([["a", "a"]] * 3 + [["a", "b"]] * 2)
        answers = Poses(np.ones((5, 5)), np.zeros((5, 2)), right, right, places[:, 0], places)
        found = cells(np.array([0.95, 0.65, 0.75, 0.05, 0.85]), answers)
        # (0.05 + 0.35 + 0.75 + 0.05 + 0.85) / 5
        self.assertEqual(found, ["0.410", "1/2", "1/1", "1/2"])

    def test_no_place_that_is_judged_was_fitted(self):
        drawn, seen = poses(400), []
        honest = fit_verdict.fit

        def watched(fitted, answers):
            seen.append(set(fitted.places.flat) | set(answers.places.flat))
            return honest(fitted, answers)

        fit_verdict.fit = watched
        try:
            with contextlib.redirect_stdout(io.StringIO()) as printed:
                held_out(drawn, {"run": drawn}, TRUE)
        finally:
            fit_verdict.fit = honest
        self.assertEqual(seen, [{"cellar"}, {"attic"}])
        self.assertIn("| attic | 200 |", printed.getvalue())
        self.assertIn("| all of these | 400 |", printed.getvalue())


if __name__ == "__main__":
    unittest.main()
