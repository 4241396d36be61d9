"""Pairs in bulk: rows as `register` finds them, whatever the pairs are given by."""

import os
import signal
import tempfile
import threading
import unittest
from importlib.util import find_spec
from pathlib import Path

import cfreg
import numpy as np
from shapes import terrain, turned

FAST = {"method": "cf", "neighbors": 40, "refine": "icp"}


class Batch(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.clouds = [turned(terrain(300, seed))[0] if seed % 2 else terrain(300, seed) for seed in range(4)]
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        for index, cloud in enumerate(cls.clouds):
            cfreg.write(cls.folder / f"{index}.ply", cloud)
        cls.pairs = [(f"{i}.ply", f"{j}.ply") for i in range(4) for j in range(4)] + [("0.ply", "absent.ply")]
        lines = ["source,target", *(",".join(pair) for pair in cls.pairs)]
        (cls.folder / "pairs.csv").write_text("\n".join(lines) + "\n")

    def test_rows_are_what_register_finds(self):
        found = cfreg.register_batch(self.pairs, folder=self.folder, **FAST)
        self.assertEqual(len(found), 17)
        for row in list(found)[:16]:
            source, target = (cfreg.read(self.folder / row[side]) for side in ("source", "target"))
            alone = cfreg.register(source, target, verdict=False, **FAST)
            np.testing.assert_array_equal(found.transform[row["index"]], alone.transform)
            self.assertEqual(row["trusted"], alone.trusted)
            self.assertEqual(row["fitness"], alone.evaluation.fitness)
        self.assertIn("absent.ply", found["error"][16])
        self.assertTrue(np.isnan(found.transform[16]).all() and not found["trusted"][16])
        self.assertIsNone(found[16]["trusted"])
        self.assertEqual((found["iterations"][16], found[-1]["iterations"], found[0]["error"]), (-1, None, None))
        self.assertIn("17 pairs", repr(found))
        self.assertEqual(list(found)[3], found[3])
        with self.assertRaises(IndexError):
            found[17]

    def test_however_pairs_are_given_rows_are_the_same(self):
        whole = cfreg.register_batch(self.folder / "pairs.csv", **FAST)
        files = [cfreg.read(self.folder / f"{index}.ply") for index in range(4)]
        arrays = [(files[i], files[j]) for i in range(4) for j in range(4)]
        names = {f"{index}.ply": cloud for index, cloud in enumerate(files)}
        for pairs, more in ((arrays, {}), (iter(self.pairs), {"clouds": names}), (self.pairs, {"folder": self.folder, "threads": 1, "memory": 0})):
            found = cfreg.register_batch(pairs, **FAST, **more)
            np.testing.assert_array_equal(found.transform[:16], whole.transform[:16])
            np.testing.assert_array_equal(found["agreement"][:16], whole["agreement"][:16])
        found = cfreg.register_batch(arrays[:2], **FAST)
        self.assertEqual(found["source"].tolist(), ["cloud 0", "cloud 0"])
        self.assertEqual(found["target"].tolist(), ["cloud 0", "cloud 1"])

    def test_verdicts_come_with_their_covariance(self):
        found = cfreg.register_batch([(self.clouds[0], self.clouds[2])])
        alone = cfreg.register(self.clouds[0], self.clouds[2])
        np.testing.assert_allclose(found.covariance[0], alone.verdict.covariance.matrix, rtol=1e-12)
        self.assertEqual(found["decision"][0], alone.verdict.decision)

    def test_accepted_poses_make_a_graph(self):
        scans = [terrain(800, seed) for seed in range(4)]
        named = {f"scan {index}": scan for index, scan in enumerate(scans)}
        found = cfreg.register_batch(cfreg.pairs.consecutive(list(named), [1, 2]), clouds=named)
        accepted = [row for row in found if row["decision"] == "accept"]
        self.assertGreater(len(accepted), 3)
        words = found.write_g2o(self.folder / "graph.g2o", names=self.folder / "names.csv")
        self.assertIn(f"4 clouds in 1 parts, {len(accepted)} edges", words)
        lines = (self.folder / "graph.g2o").read_text().splitlines()
        self.assertEqual([line.split()[0] for line in lines].count("EDGE_SE3:QUAT"), len(accepted))
        self.assertIn("0,scan 0", (self.folder / "names.csv").read_text())
        known = found["undetermined"] == 0
        np.testing.assert_allclose(
            found.information[known] @ found.covariance[known], np.broadcast_to(np.eye(6), (known.sum(), 6, 6)), atol=1e-5
        )
        with self.assertRaisesRegex(cfreg.SettingError, "rotations"):
            found.write_g2o(self.folder / "graph.g2o", rotations="euler")

    def test_what_was_written_is_read_again(self):
        found = cfreg.register_batch(self.pairs, folder=self.folder, **FAST)
        for end in ("csv", "jsonl", "parquet"):
            path = self.folder / f"again.{end}"
            cfreg.register_batch(self.pairs, folder=self.folder, output=path, **FAST)
            self.assertEqual(list(cfreg.read_batch(path)), list(found))
        with self.assertRaisesRegex(cfreg.FileFormatError, "line 2: column index"):
            cfreg.read_batch(self.folder / "pairs.csv")

    def test_pairs_arise_of_whatever_scans_are(self):
        scans = self.clouds
        self.assertTrue(cfreg.pairs.consecutive(scans)[2][0] is scans[3])
        self.assertTrue(all(target is scans[0] for _, target in cfreg.pairs.against(scans[0], scans[1:])))
        self.assertEqual(len(cfreg.pairs.within(scans, np.zeros((4, 3)), 0.0)), 6)
        with self.assertRaisesRegex(cfreg.ShapeError, "one a scan"):
            cfreg.pairs.within(scans, np.zeros((3, 3)), 1.0)
        with self.assertRaisesRegex(cfreg.SettingError, "steps"):
            cfreg.pairs.consecutive(scans, [0])

    def test_voxel_is_the_length_of_consensus_and_thins_for_others(self):
        pair = [(self.clouds[0], self.clouds[2])]
        np.testing.assert_array_equal(
            cfreg.register_batch(pair, voxel=0.2).transform[0],
            cfreg.register(*pair[0], voxel=0.2).transform,
        )
        thinned = cfreg.register_batch(pair, "cf", neighbors=40, voxel=0.2)
        self.assertEqual(thinned["source_points"][0], len(cfreg.PointCloud(self.clouds[0]).voxel(0.2)))

    def test_an_output_is_kept_and_gone_on_from(self):
        output = self.folder / "rows.csv"
        done = cfreg.register_batch(self.folder / "pairs.csv", output=output, **FAST)
        self.assertEqual((done.pairs, done.resumed, done.errors), (17, 0, 1))
        whole = output.read_bytes()
        with self.assertRaisesRegex(cfreg.SettingError, "there already"):
            cfreg.register_batch(self.folder / "pairs.csv", output=output, **FAST)

        class Enough(Exception):
            pass

        def stop(done, all):
            if done == 9:
                raise Enough

        with self.assertRaises(Enough):
            cfreg.register_batch(self.folder / "pairs.csv", output=output, overwrite=True, progress=stop, **FAST)
        output.unlink()
        self.assertTrue(Path(f"{output}.part").exists())
        again = cfreg.register_batch(self.folder / "pairs.csv", output=output, resume=True, **FAST)
        self.assertEqual(again.resumed, 9)
        self.assertEqual(output.read_bytes(), whole)
        output.unlink()

    def test_other_arrays_under_a_journal_are_told_apart(self):
        output = self.folder / "arrays.csv"
        pairs = [(self.clouds[0], self.clouds[1])] * 3

        def stop(done, all):
            if done == 1:
                raise InterruptedError

        with self.assertRaises(InterruptedError):
            cfreg.register_batch(pairs, output=output, progress=stop, **FAST)
        moved = [(self.clouds[0], self.clouds[1] + 1.0)]
        with self.assertRaisesRegex(cfreg.SettingError, "begun with clouds"):
            cfreg.register_batch(moved * 3, output=output, resume=True, **FAST)
        self.assertEqual(cfreg.register_batch(pairs, output=output, resume=True, **FAST).resumed, 1)

    def test_what_will_not_do_is_refused_up_front(self):
        pair = [(self.clouds[0], self.clouds[1])]
        wrong = {
            "threads": -1,
            "sample": 0,
            "time_limit": 0,
            "voxel": float("nan"),
            "viewpoints": "sensor",
            "memory": 1.5,
            "neighbors": 1,
        }
        for name, value in wrong.items():
            with self.subTest(name), self.assertRaisesRegex(cfreg.SettingError, "sensor" if name == "viewpoints" else name[:8]):
                cfreg.register_batch(pair, "cf", **{name: value})
        with self.assertRaisesRegex(cfreg.SettingError, "weights"):
            cfreg.register_batch(pair, "cf", weights=lambda d2: d2)
        with self.assertRaisesRegex(TypeError, "number 1 is not a pair"):
            cfreg.register_batch([*pair, self.clouds[0]])
        with self.assertRaises(FileNotFoundError):
            cfreg.register_batch("none.csv")

    def test_control_c_ends_it(self):
        self.addCleanup(signal.signal, signal.SIGINT, signal.getsignal(signal.SIGINT))
        signal.signal(signal.SIGINT, signal.default_int_handler)
        many = [(self.clouds[0], self.clouds[1])] * 100_000
        timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        with self.assertRaises(KeyboardInterrupt):
            cfreg.register_batch(many)

    @unittest.skipUnless(find_spec("pandas"), "pandas is not installed")
    def test_data_frames_have_what_rows_have(self):
        found = cfreg.register_batch(self.pairs[-2:], folder=self.folder, **FAST)
        frame = found.to_pandas()
        self.assertEqual(list(frame.columns), list(found.columns))
        self.assertTrue(frame["iterations"].isna()[1] and frame["trusted"].isna()[1])
        self.assertEqual(frame["iterations"][0], found[0]["iterations"])

    @unittest.skipUnless(find_spec("pyarrow"), "pyarrow is not installed")
    def test_arrow_is_what_is_written(self):
        import pyarrow.parquet

        found = cfreg.register_batch(self.pairs, folder=self.folder, **FAST)
        cfreg.register_batch(self.pairs, folder=self.folder, output=self.folder / "rows.parquet", **FAST)
        written = pyarrow.parquet.read_table(self.folder / "rows.parquet")
        self.assertEqual(found.to_arrow().to_pylist(), written.to_pylist())
        self.assertEqual(found.to_arrow().schema.types, written.schema.types)


if __name__ == "__main__":
    unittest.main()
