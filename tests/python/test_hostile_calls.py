"""Calls as people make them by mistake: no message is longer than a few lines, and nothing but the
package's errors, TypeError, ValueError and OSError comes out."""

import os
import subprocess
import sys
import tempfile
import unittest
import warnings
from collections.abc import Mapping
from pathlib import Path

import cfreg
import numpy as np
from cfreg import _native
from shapes import terrain, turned

try:
    import pandas
except ImportError:
    pandas = None

EXPECTED = (cfreg.Error, TypeError, ValueError, OSError)
LONGEST = 1000  # characters: a list of all settings is the longest that a message has
POINTS = terrain(60)


class Tensor:
    """As other libraries have them: numbers that become an array when they are asked."""

    def __init__(self, values):
        self.values = values

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.values, dtype=dtype)


class Broken:
    """Says that it is an array, and is none."""

    shape = (5, 3)

    def __array__(self, dtype=None, copy=None):
        raise ValueError("no array today")

    def __repr__(self):
        raise RuntimeError("no words either")


def oddities():
    """Values that are no cloud, no number and no setting, by what is odd about them."""
    big = np.arange(30_000.0).reshape(-1, 3)
    named = np.zeros(5, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4")])
    odd = {
        "none": None,
        "truth": True,
        "zero": 0,
        "minus one": -1,
        "a fraction": 2.5,
        "NaN": float("nan"),
        "infinity": float("inf"),
        "beyond 64 bits": 1 << 70,
        "below 64 bits": -(1 << 70),
        "beyond all floats": 10**400,
        "complex": 1 + 2j,
        "text": "text",
        "no text": "",
        "a long text": "long " * 10_000,
        "a NUL": "a\0b",
        "a surrogate": "a\udc80b",
        "bytes": b"bytes",
        "a path in bytes": b"/nowhere/scan.ply",
        "a bytearray": bytearray(b"1234"),
        "an absent path": Path("/nowhere/scan.ply"),
        "a folder": Path(tempfile.gettempdir()),
        "object": object(),
        "a class": np.ndarray,
        "a function": len,
        "a generator": None,  # made anew for each call
        "a range": range(3),
        "a set": {1, 2, 3},
        "a dict": {"x": 1.0},
        "a long dict": {str(i): i for i in range(5_000)},
        "an empty list": [],
        "a list of nothing": [[]],
        "a ragged list": [[0.0, 1.0, 2.0], [3.0]],
        "a list of texts": [["a", "b", "c"]],
        "a long list": list(range(10_000)),
        "a deep list": [[[[[[0.0]]]]]],
        "a list of None": [[None, None, None]],
        "a 0-d array": np.array(1.0),
        "an empty array": np.zeros((0, 3)),
        "one point": np.zeros((1, 3)),
        "two equal points": np.zeros((2, 3)),
        "a flat array": np.zeros(12),
        "two columns": np.zeros((9, 2)),
        "four columns": np.zeros((9, 4)),
        "no columns": np.zeros((9, 0)),
        "three axes": np.zeros((2, 3, 3)),
        "complex numbers": np.zeros((5, 3), complex),
        "truth values": np.zeros((5, 3), bool),
        "objects": np.full((5, 3), None),
        "objects that are numbers": np.ones((5, 3), object),
        "texts": np.full((5, 3), "1.0"),
        "dates": np.zeros((5, 3), "M8[s]"),
        "differences of dates": np.zeros((5, 3), "m8[s]"),
        "raw bytes": np.zeros((5, 3), "V4"),
        "fields": named,
        "a record array": named.view(np.recarray),
        "NaN everywhere": np.full((5, 3), np.nan),
        "some infinities": np.where(np.eye(9, 3) > 0, np.inf, 0.0),
        "huge values": np.full((5, 3), 1e308) * [1, -1, 1],
        "tiny values": np.eye(5, 3) * 1e-308,
        "beyond float32": np.eye(9, 3) * 1e39,
        "halves": POINTS.astype(np.float16),
        "long doubles": POINTS.astype(np.longdouble),
        "other bytes first": POINTS.astype(">f4"),
        "whole numbers": np.arange(30, dtype=np.int8).reshape(-1, 3),
        "large whole numbers": np.full((5, 3), (1 << 64) - 1, np.uint64),
        "Fortran's order": np.asfortranarray(POINTS),
        "backwards": POINTS[::-1, ::-1],
        "every other one": np.repeat(POINTS, 2, axis=0)[::2],
        "one row many times": np.broadcast_to(np.zeros(3), (1000, 3)),
        "read-only": np.frombuffer(POINTS.tobytes()).reshape(-1, 3),
        "a matrix": np.asmatrix(POINTS),
        "a large array": big,
        "a large list": big.tolist(),
        "a large array of texts": np.full(10_000, "text"),
        "masked": np.ma.masked_array(POINTS, POINTS > 0),
        "masked altogether": np.ma.masked_all((5, 3)),
        "masked truths": np.ma.masked_array(np.zeros((5, 3), bool), True),
        "a subclass": POINTS.view(type("Tracked", (np.ndarray,), {})),
        "a tensor": Tensor(POINTS),
        "a tensor of texts": Tensor([["a", "b", "c"]]),
        "a broken tensor": Broken(),
        "a memoryview": memoryview(np.ascontiguousarray(POINTS)),
        "a numpy scalar": np.float32(1.5),
        "a cloud": cfreg.PointCloud(POINTS),
        "an empty cloud": cfreg.PointCloud(np.zeros((0, 3))),
        "a pose": np.eye(4),
        "a method": cfreg.ICP(),
        "a prior": cfreg.Prior(direction=(0, 0, 1)),
    }
    if pandas is not None:
        odd["a data frame"] = pandas.DataFrame(POINTS, columns=list("xyz"))
        odd["a data frame of texts"] = pandas.DataFrame({"x": ["a"], "y": ["b"], "z": ["c"]})
        odd["a frame with more columns"] = pandas.DataFrame(np.zeros((9, 5)), columns=list("xyzab"))
        odd["a series"] = pandas.Series(np.arange(60.0))
    return odd


def doors(folder):
    """Every argument of every public function and method, by name: a call with an odd value."""
    cloud, column = cfreg.PointCloud(POINTS), np.arange(60.0)
    moments = cfreg.moments(POINTS, POINTS, POINTS, POINTS)
    found = cfreg.register(POINTS, POINTS, "icp")
    batch = cfreg.register_batch([(POINTS, POINTS)], "icp")
    file = os.path.join(folder, "cloud.ply")
    cfreg.write(file, cloud)

    def within_folder(value):
        # Odd paths are written below the folder, and nowhere else.
        return os.path.join(folder, value) if isinstance(value, str) else value

    calls = {
        "PointCloud points": lambda x: cfreg.PointCloud(x),
        "PointCloud normals": lambda x: cfreg.PointCloud(POINTS, normals=x),
        "PointCloud viewpoint": lambda x: cfreg.PointCloud(POINTS, viewpoint=x),
        "PointCloud weights": lambda x: cfreg.PointCloud(POINTS, weights=x),
        "PointCloud channels": lambda x: cfreg.PointCloud(POINTS, channels=x),
        "PointCloud a channel": lambda x: cfreg.PointCloud(POINTS, channels={"a": x}),
        "voxel": lambda x: cloud.voxel(x),
        "sample": lambda x: cloud.sample(x),
        "sample seed": lambda x: cloud.sample(5, x),
        "transformed": lambda x: cloud.transformed(x),
        "equal": lambda x: cloud == x if not hasattr(x, "shape") and not hasattr(x, "dtype") else True,
        "read": lambda x: cfreg.read(x),
        "write path": lambda x: cfreg.write(within_folder(x), cloud),
        "write cloud": lambda x: cfreg.write(os.path.join(folder, "out.ply"), x),
        "estimate_normals": lambda x: cfreg.estimate_normals(x),
        "estimate_normals neighbors": lambda x: cfreg.estimate_normals(POINTS, x),
        "estimate_normals viewpoint": lambda x: cfreg.estimate_normals(POINTS, 9, x),
        "fpfh": lambda x: cfreg.fpfh(x, 9),
        "fpfh neighbors": lambda x: cfreg.fpfh(POINTS, x),
        "fpfh scale": lambda x: cfreg.fpfh(POINTS, 9, x),
        "fpfh normals": lambda x: cfreg.fpfh(POINTS, 9, normals=x),
        "keypoints": lambda x: cfreg.keypoints(x),
        "keypoints detector": lambda x: cfreg.keypoints(POINTS, x),
        "keypoints values": lambda x: cfreg.keypoints(POINTS, values=x),
        "keypoints setting": lambda x: cfreg.keypoints(POINTS, min_scale=x),
        "moments points": lambda x: cfreg.moments(x, POINTS, POINTS, POINTS),
        "moments descriptors": lambda x: cfreg.moments(POINTS, POINTS, POINTS, x),
        "moments weights": lambda x: cfreg.moments(POINTS, POINTS, POINTS, POINTS, weights=x),
        "moments weights that return": lambda x: cfreg.moments(POINTS, POINTS, POINTS, POINTS, weights=lambda d2: x),
        "moments beta": lambda x: cfreg.moments(POINTS, POINTS, POINTS, POINTS, beta=x),
        "moments normalize": lambda x: cfreg.moments(POINTS, POINTS, POINTS, POINTS, normalize=x),
        "moments tolerance": lambda x: cfreg.moments(POINTS, POINTS, POINTS, POINTS, tolerance=x),
        "moments threads": lambda x: cfreg.moments(POINTS, POINTS, POINTS, POINTS, threads=x),
        "moments_of_pairs": lambda x: cfreg.moments_of_pairs(x, POINTS, [[0, 0]]),
        "moments_of_pairs pairs": lambda x: cfreg.moments_of_pairs(POINTS, POINTS, x),
        "moments_of_pairs weights": lambda x: cfreg.moments_of_pairs(POINTS, POINTS, [[0, 0]], x),
        "residual": lambda x: moments.residual(x),
        "solve": lambda x: cfreg.solve(x),
        "solve solver": lambda x: cfreg.solve(moments, x),
        "solve scale": lambda x: cfreg.solve(moments, scale=x),
        "solve prior": lambda x: cfreg.solve(moments, prior=x),
        "register": lambda x: cfreg.register(x, POINTS, "icp"),
        "register method": lambda x: cfreg.register(POINTS, POINTS, x),
        "register refine": lambda x: cfreg.register(POINTS, POINTS, "icp", refine=x),
        "register initial": lambda x: cfreg.register(POINTS, POINTS, "icp", initial=x),
        "register matches": lambda x: cfreg.register(POINTS, POINTS, "teaser", matches=x),
        "register setting": lambda x: cfreg.register(POINTS, POINTS, "icp", max_distance=x),
        "register no setting": lambda x: cfreg.register(POINTS, POINTS, "icp", absent=x),
        "register orientation": lambda x: cfreg.CF(orientation=x),
        "register channels": lambda x: cfreg.CF(channels=x),
        "register neighbors": lambda x: cfreg.CF(neighbors=x),
        "register more_neighbors": lambda x: cfreg.CF(more_neighbors=x),
        "register weights": lambda x: cfreg.CF(weights=x),
        "register beta": lambda x: cfreg.CF(beta=x),
        "register detector": lambda x: cfreg.CFK(detector=x),
        "register prior": lambda x: cfreg.ICP(prior=x),
        "register seeds": lambda x: cfreg.Consensus(seeds=x),
        "method": lambda x: cfreg.method(x),
        "prior direction": lambda x: cfreg.ICP(prior=cfreg.Prior(direction=x)),
        "prior rotation": lambda x: cfreg.ICP(prior=cfreg.Prior(rotation=x)),
        "prior within_deg": lambda x: cfreg.ICP(prior=cfreg.Prior(rotation=(0, 0, 0), within_deg=x)),
        "prior scale": lambda x: cfreg.CPD(prior=cfreg.Prior(scale=x), scale="umeyama"),
        "evaluate": lambda x: cfreg.evaluate(x, POINTS, np.eye(4)),
        "evaluate transform": lambda x: cfreg.evaluate(POINTS, POINTS, x),
        "evaluate max_distance": lambda x: cfreg.evaluate(POINTS, POINTS, np.eye(4), x),
        "evaluate truth": lambda x: cfreg.evaluate(POINTS, POINTS, np.eye(4), truth=x),
        "judge transform": lambda x: cfreg.verify(POINTS, POINTS, x, seeds=1),
        "judge setting": lambda x: cfreg.verify(POINTS, POINTS, np.eye(4), absent=x),
        "apply": lambda x: found.apply(x),
        "report path": lambda x: found.report(within_folder(x)),
        "report source": lambda x: found.report(os.path.join(folder, "out.html"), x, POINTS),
        "Registration": lambda x: cfreg.Registration(x),
        "batch pairs": lambda x: cfreg.register_batch(x, "icp"),
        "batch a pair": lambda x: cfreg.register_batch([x], "icp"),
        "batch source": lambda x: cfreg.register_batch([(x, POINTS)], "icp"),
        "batch clouds": lambda x: cfreg.register_batch([("a", "b")], "icp", clouds=x),
        "batch folder": lambda x: cfreg.register_batch([("a", "b")], "icp", folder=x),
        "batch threads": lambda x: cfreg.register_batch([], "icp", threads=x),
        "batch memory": lambda x: cfreg.register_batch([], "icp", memory=x),
        "batch time_limit": lambda x: cfreg.register_batch([], "icp", time_limit=x),
        "batch viewpoints": lambda x: cfreg.register_batch([], "icp", viewpoints=x),
        "batch voxel": lambda x: cfreg.register_batch([], "icp", voxel=x),
        "batch sample": lambda x: cfreg.register_batch([], "icp", sample=x),
        "batch seed": lambda x: cfreg.register_batch([], "icp", seed=x),
        "read_batch": lambda x: cfreg.read_batch(x),
        "write_g2o": lambda x: batch.write_g2o(within_folder(x)),
        "write_g2o rotations": lambda x: batch.write_g2o(os.path.join(folder, "out.g2o"), rotations=x),
        "BatchResult": lambda x: cfreg.BatchResult(x),
        "pairs.consecutive": lambda x: cfreg.pairs.consecutive(x),
        "pairs.consecutive steps": lambda x: cfreg.pairs.consecutive("abc", x),
        "pairs.consecutive a step": lambda x: cfreg.pairs.consecutive("abc", [x]),
        "pairs.against": lambda x: cfreg.pairs.against("map", x),
        "pairs.within": lambda x: cfreg.pairs.within("abc", x, 1.0),
        "pairs.within radius": lambda x: cfreg.pairs.within("abc", np.eye(3), x),
        "sinkhorn": lambda x: cfreg.weights.sinkhorn(x),
        "Gaussian": lambda x: cfreg.weights.Gaussian(x),
        "StudentT": lambda x: cfreg.weights.StudentT(nu=x),
        "a kernel": lambda x: cfreg.weights.Gaussian()(x),
        "a sum": lambda x: cfreg.weights.Gaussian() + x if not isinstance(x, np.ndarray) else None,
        "a product": lambda x: cfreg.weights.Gaussian() * x if not isinstance(x, np.ndarray) else None,
    }
    return calls


class Doors(unittest.TestCase):
    def test_odd_values_end_in_a_short_message_of_a_known_class(self):
        tried = answered = 0
        wrong = []
        values = oddities()
        self.addCleanup(os.chdir, os.getcwd())
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            os.chdir(folder)  # a path in bytes is written there
            for door, call in doors(folder).items():
                for what, value in values.items():
                    tried += 1
                    if what == "a generator":
                        value = (row for row in [[0.0, 0.0, 0.0]])
                    try:
                        call(value)
                        answered += 1
                    except EXPECTED as error:
                        # Those of the system have the path, as those of `open` do.
                        if len(str(error)) > LONGEST and not isinstance(error, OSError):
                            wrong.append(f"{door}, {what}: {len(str(error))} characters: {str(error)[:200]}")
                        if isinstance(error, cfreg.InternalError):
                            wrong.append(f"{door}, {what}: {error}")
                    except BaseException as error:
                        wrong.append(f"{door}, {what}: {type(error).__name__}: {str(error)[:200]}")
        print(f"{tried} odd calls, {answered} of them answered")
        self.assertEqual(wrong, [], f"{len(wrong)} of {tried}\n" + "\n".join(wrong[:100]))


class Messages(unittest.TestCase):
    def test_arrays_are_told_in_short(self):
        big = np.arange(300_000.0).reshape(-1, 3)
        said = r"array of float64 with shape \(100000, 3\) \[0\.0, 1\.0, 2\.0, \.\.\.\]"
        for name, call in {
            "viewpoint": lambda: cfreg.PointCloud(POINTS, viewpoint=big),
            "transform": lambda: cfreg.evaluate(POINTS, POINTS, big),
            "prior.direction": lambda: cfreg.ICP(prior=cfreg.Prior(direction=big)),
            "orientation": lambda: cfreg.CF(orientation=big.tolist()),
            "absent": lambda: cfreg.register(POINTS, POINTS, "icp", absent=big),
            "method": lambda: cfreg.register(POINTS, POINTS, big),
        }.items():
            with self.subTest(name), self.assertRaises((cfreg.Error, TypeError)) as caught:
                call()
            self.assertRegex(str(caught.exception), f"^{name}")
            self.assertLess(len(str(caught.exception)), 400)
            if "(" in str(caught.exception) and name != "orientation":
                self.assertRegex(str(caught.exception), f"{said}|tuple|\\(\\(0.0, 1.0, 2.0\\)")

    def test_mappings_and_frames_are_channels(self):
        class Columns(Mapping):
            def __getitem__(self, name):
                return {"a": POINTS[:, 0]}[name]

            def __iter__(self):
                return iter(["a"])

            def __len__(self):
                return 1

        cloud = cfreg.PointCloud(POINTS, channels=Columns())
        np.testing.assert_array_equal(cloud.channels["a"], POINTS[:, 0].astype(np.float32))
        with self.assertRaisesRegex(TypeError, "^channels: names must be texts, not 3"):
            cfreg.PointCloud(POINTS, channels={3: POINTS[:, 0]})
        with self.assertRaisesRegex(TypeError, "^channels: must be {name"):
            cfreg.PointCloud(POINTS, channels=5)

    @unittest.skipUnless(pandas, "pandas is not installed")
    def test_a_frame_is_a_pose_and_columns(self):
        _, matrix = turned(POINTS)
        moved = cfreg.PointCloud(POINTS).transformed(pandas.DataFrame(matrix))
        self.assertEqual(moved, cfreg.PointCloud(POINTS).transformed(matrix))
        frame = pandas.DataFrame({"i": POINTS[:, 0]})
        self.assertIn("i", cfreg.PointCloud(POINTS, channels=frame).channels)

    def test_fields_and_bytes_are_named(self):
        fields = np.zeros(5, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4")])
        with self.assertRaisesRegex(cfreg.Error, r"^points has the fields \('x', 'y', 'z'\)"):
            cfreg.PointCloud(fields)
        with self.assertRaisesRegex(cfreg.Error, "^source must be a cloud, not bytes.*os.fsdecode"):
            cfreg.register(b"scan.ply", POINTS)


@unittest.skipUnless(hasattr(_native, "_panic"), "a build for release has no panic to test with")
class Panics(unittest.TestCase):
    def test_a_panic_is_an_exception_and_prints_nothing(self):
        program = (
            "import cfreg\n"
            "from cfreg import _native\n"
            "for place in ('work', 'loop', 'detached', 'glue'):\n"
            "    try: _native._panic(place)\n"
            "    except cfreg.InternalError as error: print(error)\n"
            "print(len(cfreg.fpfh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], 3)))\n"
        )
        environment = {name: value for name, value in os.environ.items() if name != "RUST_BACKTRACE"}
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        lines = done.stdout.splitlines()
        for place, line in zip(("work", "loop", "detached", "glue"), lines):
            expected = rf"^a bug in cfreg, please report it: asked for in {place} \(python/src/panics.rs:\d+:\d+\)$"
            self.assertRegex(line, expected)
        self.assertEqual(lines[4:], ["4"])


if __name__ == "__main__":
    unittest.main()
