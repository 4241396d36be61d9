"""The tutorial runs, and what it shows is right."""

import contextlib
import csv
import importlib.util
import io
import os
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import cfreg
import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]
TUTORIAL = [sys.executable, "-m", "peers.tutorial"]
IMPORTS = {"PYTHONPATH": str(REPOSITORY / "python-ref")}
DATA = Path(os.environ.get("CFREG_DATA", REPOSITORY.parent / "shared" / "data"))


@unittest.skipUnless(importlib.util.find_spec("matplotlib"), "matplotlib is not installed")
class Tutorial(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def run_it(self, *arguments, data=None):
        environment = os.environ | IMPORTS | ({} if data is None else {"CFREG_DATA": data})
        program = [*TUTORIAL, "--output", self.folder, *arguments]
        done = subprocess.run(program, capture_output=True, text=True, env=environment)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def shows_something(self, name):
        import matplotlib.image

        self.assertEqual((self.folder / name).read_bytes()[:4], b"\x89PNG")
        picture = matplotlib.image.imread(self.folder / name)
        colours = np.unique(picture.reshape(-1, picture.shape[2]), axis=0)
        self.assertGreater(len(colours), 10, name)

    def test_from_two_reliefs(self):
        told = self.run_it("--points", "1000", data="/nowhere")
        self.assertIn("two reliefs instead", told)
        self.assertIn("trusted", told)
        off = float(told.split("off by ")[1].split()[0])
        self.assertLess(off, 0.2)
        for name in ("aligned.png", "kernels.png", "weights.png"):
            self.shows_something(name)
        with open(self.folder / "weights.csv") as file:
            rows = list(csv.DictReader(file))
        self.assertEqual(len(rows), 18)
        self.assertEqual({row["normalize"] for row in rows}, {"none", "source", "target", "both", "sinkhorn:10"})
        # Weights that are all alike determine no rotation.
        self.assertEqual((rows[0]["weights"], rows[0]["trusted"]), ("Uniform()", "DegenerateError"))
        for row in rows[1:]:
            self.assertLess(float(row["rotation off, deg"]), 10.0, row["weights"])
            self.assertEqual(row["trusted"], "True", row["weights"])
            self.assertIn(row["weights"], told)
        self.assertIn("by hand the pose differs by 0e+00", told)
        target = cfreg.read(self.folder / "target.pcd")
        aligned = cfreg.read(self.folder / "aligned.ply")
        self.assertGreater(cfreg.evaluate(aligned, target, np.eye(4)).agreement, 0.8)

    def test_from_files_of_ones_own(self):
        points = np.random.default_rng(0).random((300, 3)) * [3.0, 2.0, 1.0]
        for name in ("a.ply", "b.ply"):
            cfreg.write(self.folder / name, points)
        np.savetxt(self.folder / "T.txt", np.eye(4))
        files = [self.folder / "a.ply", self.folder / "b.ply"]
        self.assertIn("off by 0.00 deg", self.run_it(*files, "--truth", self.folder / "T.txt"))
        self.assertNotIn("off by", self.run_it(*files))

    def test_one_file_is_not_enough(self):
        program = [*TUTORIAL, "a.ply", "--output", self.folder / "none"]
        done = subprocess.run(program, capture_output=True, text=True, env=os.environ | IMPORTS)
        self.assertEqual(done.returncode, 2)
        self.assertIn("a SOURCE needs its TARGET", done.stderr)
        self.assertFalse((self.folder / "none").exists())

    @unittest.skipUnless(DATA.is_dir(), "the scans are not there")
    def test_the_ten_lines_of_the_manual_print_what_it_says(self):
        import matplotlib

        page = (REPOSITORY / "docs/from_open3d.md").read_text(encoding="utf-8")
        [lines] = re.findall(r"```python\n(import cfreg, matplotlib.*?)```", page, re.DOTALL)
        lines = lines.replace('"data/scans/', f'"{DATA.as_posix()}/stanford_bunny/')
        lines = lines.replace('"aligned.png"', repr(str(self.folder / "aligned.png")))
        names, told = {}, io.StringIO()
        with matplotlib.rc_context({"backend": "Agg"}), contextlib.redirect_stdout(told):
            exec(lines, names)
        self.shows_something("aligned.png")
        [words] = re.findall(r"print\(found\) +# (accept, .*), \.\.\.", page)
        self.assertIn(f"({words}, ", told.getvalue())
        with open(DATA / "pairs.csv") as file:
            pairs = csv.DictReader(line for line in file if not line.startswith("#"))
            files = "stanford_bunny/bun000.ply", "stanford_bunny/bun045.ply"
            [pair] = [row for row in pairs if (row["source"], row["target"]) == files]
        truth = [[float(pair[f"t{i}{j}"]) for j in range(4)] for i in range(4)]
        clouds = names["source"], names["target"]
        error = cfreg.evaluate(*clouds, names["found"].transform, truth=truth).truth
        [off] = re.findall(r"the same pose\s+\((\S+) degrees off, as here;", page)
        self.assertEqual(f"{error.rotation_deg:.2f}", off)


if __name__ == "__main__":
    unittest.main()
