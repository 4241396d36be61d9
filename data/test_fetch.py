"""What fetch.py promises: python3 -m unittest discover data"""

import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

HERE = Path(__file__).resolve().parent


def fetch(*names, **environment):
    command = [sys.executable, str(HERE / "fetch.py"), *names]
    return subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True)


class Fetch(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.scans = Path(self.folder.name) / "scans"

    def run_fetch(self, *names, mirror):
        return fetch(*names, CFREG_DATA=str(mirror), CFREG_SCANS=str(self.scans))

    def test_an_unknown_name_is_refused_with_the_known_ones(self):
        done = self.run_fetch("teapot", mirror=self.folder.name)
        self.assertEqual(done.returncode, 1)
        self.assertIn("bun000", done.stderr)

    def test_a_file_that_differs_is_refused_and_not_written(self):
        mirror = Path(self.folder.name) / "mirror"
        (mirror / "stanford_bunny").mkdir(parents=True)
        (mirror / "stanford_bunny" / "bun000.ply").write_text("ply\n")
        done = self.run_fetch("bun000", mirror=mirror)
        self.assertEqual(done.returncode, 1)
        self.assertIn("sha256", done.stderr)
        self.assertFalse(self.scans.exists())

    def test_a_mirror_without_the_file_is_named(self):
        done = self.run_fetch("bun000", mirror=self.folder.name)
        self.assertEqual(done.returncode, 1)
        self.assertIn("bun000.ply", done.stderr)
        self.assertEqual(len(done.stderr.splitlines()), 1)

    def test_a_mirror_serves_every_scan(self):
        beside = HERE.parent.parent / "shared" / "data"
        mirror = Path(os.environ.get("CFREG_DATA") or beside)
        if not mirror.is_dir():
            self.skipTest("no mirror: neither CFREG_DATA nor ../shared/data")
        done = self.run_fetch(mirror=mirror)
        self.assertEqual(done.returncode, 0, done.stderr)
        names = [scan["name"] for scan in json.loads((HERE / "manifest.json").read_text())["scans"]]
        self.assertEqual(sorted(path.stem for path in self.scans.iterdir()), sorted(names))


if __name__ == "__main__":
    unittest.main()
