"""Pairs in bulk on a cluster of Ray: several raylets on this machine, one of which is lost."""

import logging
import os
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from importlib.util import find_spec
from pathlib import Path

import cfreg
import numpy as np
from shapes import terrain

HERE = find_spec("ray") and find_spec("pyarrow")
FAST = {"method": "cf", "neighbors": 30, "refine": "icp"}
CLOUDS = 12


@unittest.skipUnless(HERE, "ray is not installed: pip install 'cfreg[ray]'")
class Cluster(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        os.environ.update(RAY_DEDUP_LOGS="0", RAY_USAGE_STATS_ENABLED="0", RAY_DATA_DISABLE_PROGRESS_BARS="1")
        import ray
        from ray.cluster_utils import Cluster

        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        for number in range(CLOUDS):
            cfreg.write(cls.folder / f"{number}.ply", terrain(300, number))
        pairs = [(f"{i}.ply", f"{j}.ply") for i in range(CLOUDS) for j in range(CLOUDS)] + [("0.ply", "absent.ply")]
        cls.list = cls.folder / "pairs.csv"
        cls.list.write_text("source,target\n" + "".join(f"{a},{b}\n" for a, b in pairs))
        cls.whole = cfreg.register_batch(cls.list, output=cls.folder / "whole.parquet", **FAST)
        # The first has the driver alone: work is done on machines that may be lost.
        small = {"object_store_memory": 80 << 20}
        # A machine that does not answer for a second and a half is lost.
        soon = {"health_check_initial_delay_ms": 0, "health_check_period_ms": 500, "health_check_timeout_ms": 500, "health_check_failure_threshold": 3}
        cls.cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "_system_config": soon, **small})
        cls.addClassCleanup(cls.cluster.shutdown)
        cls.nodes = [cls.cluster.add_node(num_cpus=1, **small) for _ in range(2)]
        ray.init(address=cls.cluster.address, log_to_driver=False, logging_level="ERROR")
        cls.addClassCleanup(ray.shutdown)
        logging.getLogger("ray.data._internal").setLevel(logging.ERROR)

    def same(self, output):
        """That the rows are those of one machine."""
        one, many = (cfreg.read_batch(path) for path in (self.folder / "whole.parquet", output))
        self.assertEqual(len(many), CLOUDS * CLOUDS + 1)
        self.assertEqual(list(one), list(many))

    def test_a_run_is_that_of_one_machine_and_goes_on_where_it_was_cut_short(self):
        from cfreg import ray

        output = self.folder / "rows"
        done = ray.register_batch(self.list, output, block=40, **FAST)
        self.assertEqual((done.pairs, done.resumed, done.errors), (CLOUDS * CLOUDS + 1, 0, 1))
        self.assertEqual(done.trusted, self.whole.trusted)
        self.same(output)
        with self.assertRaisesRegex(cfreg.SettingError, "resume"):
            ray.register_batch(self.list, output, **FAST)
        with self.assertRaisesRegex(cfreg.SettingError, "begun with method"):
            ray.register_batch(self.list, output, "cf", resume=True)
        lost, cut, *_ = sorted(output.glob("*.parquet"))
        lost.unlink()
        cut.write_bytes(cut.read_bytes()[:-100])
        again = ray.register_batch(self.list, output, block=7, resume=True, **FAST)
        self.assertGreater(again.resumed, 20)
        self.assertLess(again.resumed, 140)
        self.same(output)

    def test_a_machine_that_is_lost_costs_no_row(self):
        from cfreg import ray

        output = self.folder / "lost"

        def lose():
            while not list(output.glob("*.parquet")):
                time.sleep(0.02)
            self.cluster.remove_node(self.nodes.pop(), allow_graceful=False)
            self.lost_at = len(list(output.glob("*.parquet")))

        loser = threading.Thread(target=lose)
        loser.start()
        done = ray.register_batch(self.list, output, block=4, **FAST)
        loser.join()
        self.cluster.add_node(num_cpus=1, object_store_memory=80 << 20)
        self.assertEqual(done.pairs, CLOUDS * CLOUDS + 1)
        self.assertLess(self.lost_at, 30, "it was lost too late for this test")
        self.same(output)

    def test_object_storage_is_as_good_as_a_folder(self):
        from cfreg import ray

        uri = f"file://{self.folder}"
        done = ray.register_batch(f"{uri}/pairs.csv", f"{uri}/stored", block=50, **FAST)
        self.assertEqual(done.errors, 1)
        stored, one = (cfreg.read_batch(self.folder / name) for name in ("stored", "whole.parquet"))
        np.testing.assert_array_equal(stored.transform, one.transform)
        self.assertEqual(stored["source"].tolist(), one["source"].tolist())
        self.assertIn(f"{uri}/absent.ply", stored["error"][-1])

    def test_the_command_does_the_same(self):
        command = [sys.executable, "-m", "cfreg.ray", str(self.list), str(self.folder / "command")]
        command += ["--address", self.cluster.address, "--method", "cf+icp", "--set", "neighbors=30"]
        done = subprocess.run(command, capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("145 pairs: ", done.stderr)
        self.same(self.folder / "command")
        again = subprocess.run(command, capture_output=True, text=True)
        self.assertEqual(again.returncode, 2)
        self.assertIn("an earlier run has left rows", again.stderr)


if __name__ == "__main__":
    unittest.main()
