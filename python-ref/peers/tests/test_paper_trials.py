"""The trials of the peers: read as they were written, judged rightly, summed up rightly."""

import tempfile
import unittest
from dataclasses import replace
from pathlib import Path

import numpy as np

from peers.paper_trials import pairs, paper_tables, trials
from peers.paper_trials.contenders import Contender
from reference.rotations import from_vector


class Trials(unittest.TestCase):
    def setUp(self):
        (self.cell, _) = pairs.reliefs(3)
        self.pair = self.cell.pairs[0]

    def test_pairs_come_back_as_they_were_written(self):
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / self.cell.name
            place.mkdir()
            for name in ("source", "target", "truth", "viewpoints"):
                np.save(place / f"{name}.npy", [getattr(pair, name) for pair in self.cell.pairs])
            (cell,) = pairs.read(Path(folder))
        self.assertEqual(cell.name, self.cell.name)
        for found, given in zip(cell.pairs, self.cell.pairs, strict=True):
            for name in ("source", "target", "truth", "viewpoints"):
                np.testing.assert_array_equal(getattr(found, name), getattr(given, name))

    def test_the_spacing_is_the_side_of_a_points_share(self):
        points = np.random.default_rng(1).uniform(0, 3, (2000, 3)) * [1, 1, 0]
        share = np.sqrt(9 / 2000)
        self.assertAlmostEqual(replace(self.pair, source=points).spacing() / share, 1, delta=0.05)

    def test_a_known_error_is_found(self):
        turn, center = from_vector([0.0, 0.0, np.radians(10)]), self.pair.source.mean(axis=0)
        off = np.eye(4)
        off[:3, :3] = turn
        # About where the centroid belongs, and then 0.25 along y.
        place = self.pair.truth[:3, :3] @ center + self.pair.truth[:3, 3]
        off[:3, 3] = place - turn @ place + [0.0, 0.25, 0.0]
        found = trials.evaluated(7, off @ self.pair.truth, self.pair)
        self.assertAlmostEqual(found.rotation_deg, 10.0)
        # |I - R|_F = 2 sqrt(2) sin(angle / 2).
        self.assertAlmostEqual(found.frobenius, 2 * np.sqrt(2) * np.sin(np.radians(5)))
        self.assertAlmostEqual(found.translation, 0.25)
        self.assertGreater(found.average_shift, 0.25)
        self.assertFalse(found.lost())

    def test_no_answer_is_a_record_that_is_lost(self):
        def refuses(pair):
            raise RuntimeError("too small")

        for align, why in ((refuses, "too small"), (lambda pair: None, "no answer")):
            records = trials.register(Contender("it", "numpy", {}, align), self.cell)
            self.assertEqual([record.error for record in records], [why] * 3)
            self.assertTrue(all(record.lost() for record in records))

    def test_records_come_back_also_from_the_crates_files(self):
        records = [trials.evaluated(0, self.pair.truth, self.pair), trials.Record(1, error="a, b")]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "cell.csv"
            trials.write(records, path, cell="cell")
            self.assertEqual(trials.read(path), records)
            path.write_text(
                "# {}\ntrial,rotation_deg,frobenius,translation,average_shift,"
                "trusted,iterations,error\n"
                "0,1.5,0.25,0.5,0.75,true,1,\n1,,,,,false,0,why\n"
            )
            given = [trials.Record(0, 1.5, 0.25, 0.5, 0.75), trials.Record(1, error="why")]
            self.assertEqual(trials.read(path), given)

    def test_a_summary_counts_the_lost_and_averages_the_answered(self):
        errors = (0.1, 0.2, 0.9)
        found = [trials.Record(k, 1, error, 1, 1) for k, error in enumerate(errors)]
        found.append(trials.Record(3))
        self.assertEqual(paper_tables.summary(found, "frobenius"), "0.40 ± 0.36 (0.20; 2)")
        self.assertEqual(paper_tables.summary(found[3:], "frobenius"), "none (1 lost)")


if __name__ == "__main__":
    unittest.main()
