"""The fit of the verdict model, on poses whose probabilities are known."""

import contextlib
import io
import json
import unittest

import numpy as np

from verdict import fit_verdict
from verdict.fit_verdict import (
    EVIDENCE,
    FOUND,
    MODEL,
    Model,
    Poses,
    calibration_error,
    crate_model,
    fit,
    interval,
    left_out,
    logistic,
    model_file,
    print_left_out,
    results,
    source_of,
)

SIGNS = np.array(list(EVIDENCE.values()))
TRUE = Model(
    SIGNS * np.array([1.0, 2.0, 0.5, 1.5, 0.7, 0.3, 0.4]),
    np.r_[-1.0, SIGNS * np.array([0.5, 1.0, 0.3, 0.6, 0.2, 0.4, 0.3]), 0.8, -0.4, 0.3],
)


def poses(pairs, each=6, seed=1):
    """Poses of pairs of two sources, of which one is right: pose k by the odds of `TRUE`."""
    rng = np.random.default_rng(seed)
    terms = rng.normal(size=(pairs, each, len(EVIDENCE)))
    share = np.exp(terms @ TRUE.pose)
    share /= share.sum(axis=1, keepdims=True)
    chosen = (share.cumsum(axis=1) > rng.uniform(size=(pairs, 1))).argmax(axis=1)
    right = np.arange(each) == chosen[:, None]
    numbers = np.repeat(np.arange(pairs), each)
    sources = np.array([["attic", "attic"], ["cellar", "cellar"]])[numbers % 2]
    found, free = np.zeros((pairs * each, len(FOUND))), np.zeros(pairs * each, bool)
    return Poses(terms.reshape(-1, len(EVIDENCE)), found, right.ravel(), free, numbers, sources[:, 0], sources)


def answers(count, seed=2):
    """Answers that are right with the probability that `TRUE` gives."""
    rng = np.random.default_rng(seed)
    terms, found = rng.normal(size=(count, len(EVIDENCE))), rng.normal(size=(count, len(FOUND)))
    sources = np.array([["attic", "attic"], ["cellar", "cellar"]])[np.arange(count) % 2]
    drawn = Poses(terms, found, *np.zeros((2, count), bool), np.arange(count), sources[:, 0], sources)
    drawn.right = rng.uniform(size=count) < TRUE.probabilities(drawn)
    return drawn


class Fit(unittest.TestCase):
    def test_the_coefficients_come_back(self):
        drawn = answers(20_000)
        model = fit(poses(6_000), drawn)
        np.testing.assert_allclose(model.pose, TRUE.pose, atol=0.1)
        np.testing.assert_allclose(model.answer, TRUE.answer, atol=0.1)
        self.assertLess(calibration_error(model.probabilities(drawn), drawn.right), 0.02)

    def test_a_coefficient_of_the_wrong_sign_is_zero(self):
        rng = np.random.default_rng(3)
        terms = rng.normal(size=(2_000, 2))
        right = rng.uniform(size=2_000) < 1 / (1 + np.exp(-terms @ [1.0, 1.0]))
        found = logistic(terms, right, [+1, -1], 1.0)
        self.assertGreater(found[1], 0.7)
        self.assertEqual(found[2], 0.0)

    def test_a_model_file_has_what_the_crate_reads(self):
        model = model_file(TRUE, "test", "made")
        crate = json.loads(MODEL.read_text())
        self.assertEqual(list(model), list(crate))
        for part in ("pose", "answer", "thresholds"):
            self.assertEqual(set(model[part]), set(crate[part]))
        self.assertEqual(model["pose"]["surface_conflict"], -2.0)
        self.assertEqual(model["answer"]["translation_std"], -0.4)

    def test_the_coefficients_of_the_crate_have_their_signs(self):
        crate = crate_model()
        self.assertTrue((crate.pose * SIGNS >= 0).all())
        self.assertTrue((crate.answer[1:] * [*SIGNS, *FOUND.values()] >= 0).all())
        self.assertLess(crate.answer[2], -0.5)


class ScoredPose(unittest.TestCase):
    def test_scans_of_the_kitchen_are_one_source(self):
        files = ["x/rgbd_tsdf_fusion/a.ply", "y/7-scenes-redkitchen/b.ply", "rgbd_7scenes_frames/c.ply"]
        self.assertEqual({source_of(file) for file in files}, {"kitchen"})
        self.assertEqual(source_of("x/kitti00/1.ply"), "kitti00")

    def test_accepted_and_refused_answers_are_counted(self):
        right = np.array([True, True, True, False, False, False])
        sets = np.array(["a"] * 4 + ["unrelated rooms"] * 2)
        free, pair = np.zeros(6, bool), np.array([["a", "a"]] * 6)
        drawn = Poses(np.ones((6, 7)), np.zeros((6, len(FOUND))), right, free, np.arange(6), sets, pair)
        probability = np.array([0.95, 0.65, 0.05, 0.85, 0.02, 0.9])
        counts = lambda: [cell.split(" ")[0] for cell in results(probability, drawn)[1:]]
        self.assertEqual(counts(), ["1/2", "1/1", "2/3", "1/3"])
        # Ambiguous answers are not accepted, whatever their probability.
        free[[0, 3]] = True
        self.assertEqual(counts(), ["1/2", "0/1", "3/3", "1/3"])

    def test_intervals_are_those_of_clopper_and_pearson(self):
        self.assertEqual(interval(0, 10), "0/10 (0.0-30.8 %)")
        self.assertEqual(interval(1, 10), "1/10 (0.3-44.5 %)")
        self.assertEqual(interval(10, 10), "10/10 (69.2-100.0 %)")
        self.assertEqual(interval(0, 0), "-")

    def test_no_source_that_is_judged_was_fitted(self):
        drawn, judged, seen = poses(60), answers(400), []
        honest = fit_verdict.fit

        def watched(fitted, answers):
            seen.append(set(fitted.sources.flat) | set(answers.sources.flat))
            return honest(fitted, answers)

        fit_verdict.fit = watched
        try:
            told = left_out(drawn, judged)
        finally:
            fit_verdict.fit = honest
        self.assertEqual(seen, [{"cellar"}, {"attic"}])
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            print_left_out(told, judged)
        self.assertIn("| attic | 200 |", printed.getvalue())
        self.assertIn("| all real scans | 400 |", printed.getvalue())


if __name__ == "__main__":
    unittest.main()
