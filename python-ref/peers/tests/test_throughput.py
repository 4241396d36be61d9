"""The bench of pairs in bulk counts right poses, rates and memory."""

import tempfile
import unittest
from pathlib import Path

import numpy as np

from peers import throughput
from peers.programs import is_installed


class Throughput(unittest.TestCase):
    def test_right_is_near_the_truth(self):
        truth = np.eye(4)
        truth[:3, 3] = [1, 2, 3]
        turned = truth.copy()
        turned[:2, :2] = [[0.98, -0.199], [0.199, 0.98]]  # 11.5 degrees
        moved = truth.copy()
        moved[0, 3] += 0.06
        self.assertTrue(throughput.is_right(truth, truth, 1.0))
        self.assertFalse(throughput.is_right(turned, truth, 1.0))
        self.assertFalse(throughput.is_right(moved, truth, 1.0))
        self.assertTrue(throughput.is_right(moved, truth, 2.0))
        self.assertFalse(throughput.is_right(np.full((4, 4), np.nan), truth, 1.0))

    @unittest.skipUnless(is_installed("cfreg"), "cfreg is not installed")
    def test_pairs_are_downsampled_and_counted(self):
        import cfreg

        with tempfile.TemporaryDirectory() as room:
            data = Path(room, "data")
            data.mkdir()
            x, y = np.random.default_rng(0).uniform(-1, 1, (2, 900))
            points = np.column_stack([x, y, 0.4 * np.sin(3 * x + y) + 0.2 * x * x])
            for name in "ab":
                cfreg.write(data / f"{name}.ply", points)
            titles = [f"t{i}{j}" for i in range(4) for j in range(4)]
            rows = [f"dataset,source,target,{','.join(titles)}"]
            unit = ",".join(str(int(i == j)) for i in range(4) for j in range(4))
            rows += [f"stanford_bunny,a.ply,b.ply,{unit}", f"kitti00,a.ply,b.ply,{unit}"]
            (data / "pairs.csv").write_text("\n".join(rows) + "\n")
            folder = Path(room, "downsampled")
            folder.mkdir()
            pairs = throughput.downsampled_pairs(data, 400, folder)
            self.assertEqual([pair[:2] for pair in pairs], [("a.ply", "b.ply")])
            self.assertEqual(len(cfreg.read(folder / "a.ply")), 400)
            count, rate, right = throughput.pairs_a_second("cfreg", folder, pairs, 1, 0.2)
            self.assertTrue(count >= 1 and rate > 0 and right == 1.0)
            self.assertTrue(0.1 < throughput.busy(folder, pairs * 4, 1) < 1.0)
            held = throughput.memory(folder, 50)
            self.assertEqual(len(held), 11)


if __name__ == "__main__":
    unittest.main()
