"""Long calls: other threads go on, Ctrl-C ends them, processes may fork."""

import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cfreg
import numpy as np
from shapes import terrain, turned


def long_calls():
    """Every kind of call that takes its time, by name, each for some tenths of a second."""
    points = terrain(6000)
    cloud = cfreg.PointCloud(points)
    descriptors = cfreg.fpfh(points, neighbors=20)
    many = np.random.default_rng(0).random((2_000_000, 3))
    pairs = np.random.default_rng(0).integers(0, 6000, (3_000_000, 2))
    file = Path(tempfile.mkdtemp(), "many.xyz")
    cfreg.write(file, many[:200_000])

    def function(d2):
        time.sleep(0.001)
        return d2 < 50

    return {
        "PointCloud": lambda: cfreg.PointCloud(many),
        "read": lambda: cfreg.read(file),
        "write": lambda: cfreg.write(file, many[:200_000]),
        "voxel": lambda: cfreg.PointCloud(many[:1_000_000]).voxel(0.01),
        "resolution": lambda: cfreg.PointCloud(many[:300_000]).resolution,
        "estimate_normals": lambda: cfreg.estimate_normals(points),
        "keypoints": lambda: cfreg.keypoints(points),
        "fpfh": lambda: cfreg.fpfh(points),
        "moments": lambda: cfreg.moments(
            points, points, descriptors, descriptors, normalize="sinkhorn:4", threads=1
        ),
        "moments by a function": lambda: cfreg.moments(
            points, points, descriptors, descriptors, weights=function
        ),
        "moments_of_pairs": lambda: cfreg.moments_of_pairs(points, points, pairs),
        "register": lambda: cfreg.register(cloud, cloud, threads=1),
        "evaluate": lambda: cfreg.evaluate(many[:200_000], many[:200_000], np.eye(4)),
    }


def turns_during(call):
    """How often this thread gets its turn, every millisecond at most, while another
    thread runs `call`, and the longest wait for one in seconds."""
    done = threading.Event()

    def work():
        call()
        done.set()

    worker = threading.Thread(target=work)
    last = time.perf_counter()
    worker.start()
    turns, longest = 0, 0.0
    while not done.wait(0.001):
        now = time.perf_counter()
        turns, longest, last = turns + 1, max(longest, now - last), now
    worker.join()
    return turns, longest


class Threads(unittest.TestCase):
    def test_other_threads_go_on(self):
        for name, call in long_calls().items():
            with self.subTest(name):
                # A call that keeps the interpreter gives one or two turns.
                self.assertGreater(turns_during(call)[0], 5)

    def test_two_calls_overlap(self):
        """Both are within at the same time: each waits for the other there."""
        meeting = threading.Barrier(2, timeout=60)
        met = threading.local()

        def meet(d2):
            if not hasattr(met, "already"):
                met.already = True
                meeting.wait()
            return d2 < 1.0

        points = terrain(100)
        with ThreadPoolExecutor(2) as pool:
            calls = [
                pool.submit(cfreg.moments, points, points, points, points, weights=meet, threads=1)
                for _ in range(2)
            ]
            found = [call.result(timeout=120) for call in calls]
        self.assertEqual(found[0].weight, found[1].weight)

    def test_many_threads_share_clouds_and_get_the_same_bits(self):
        source, target = cfreg.PointCloud(terrain(700, seed=1)), cfreg.PointCloud(turned(terrain(700, seed=2))[0])
        alone = cfreg.register(source, target, "cf", neighbors=50)

        def work(index):
            # Views are made at the same time too.
            self.assertEqual(source.points.shape, target.points.shape)
            return cfreg.register(source, target, "cf", neighbors=50, threads=index % 3)

        with ThreadPoolExecutor(8) as pool:
            for found in pool.map(work, range(24)):
                np.testing.assert_array_equal(found.transform, alone.transform)

    def test_a_function_may_wait_for_a_lock_that_another_call_is_made_under(self):
        lock, held = threading.Lock(), threading.Event()
        many = terrain(6000)

        def call():
            with lock:
                held.set()
                time.sleep(0.2)
                cfreg.fpfh(many)

        def wait(d2):
            with lock:
                return np.ones(d2.shape)

        few = terrain(300)
        with ThreadPoolExecutor(1) as pool:
            other = pool.submit(call)
            self.assertTrue(held.wait(60))
            self.assertEqual(cfreg.moments(few, few, few, few, weights=wait).weight, 300 * 300)
            other.result(timeout=120)

    def test_arrays_may_be_written_to_meanwhile(self):
        points = terrain(3000)
        expected = cfreg.fpfh(points.copy())
        begun, go_on = threading.Event(), [True]

        def write():
            while go_on[0]:
                points[:] = 0.0
                points[:] = np.nan

        with ThreadPoolExecutor(2) as pool:
            def weigh(d2):
                begun.set()
                time.sleep(0.05)
                return np.ones(d2.shape)

            call = pool.submit(cfreg.moments, points, points, expected, expected, weights=weigh, threads=1)
            self.assertTrue(begun.wait(60))
            writer = pool.submit(write)
            found = call.result(timeout=120)
            go_on[0] = False
            writer.result(timeout=60)
        self.assertEqual(found.weight, 9e6)
        self.assertTrue(np.isfinite(found.cross).all())


class Interrupts(unittest.TestCase):
    def setUp(self):
        # Shells start what runs in the background with the signal ignored.
        self.addCleanup(signal.signal, signal.SIGINT, signal.getsignal(signal.SIGINT))
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def ended(self, call):
        """Seconds from Ctrl-C to KeyboardInterrupt."""
        sent, ended = [], threading.Event()

        def send():
            if not ended.wait(0.3):
                sent.append(time.perf_counter())
                os.kill(os.getpid(), signal.SIGINT)

        sender = threading.Thread(target=send)
        sender.start()
        try:
            call()
        except KeyboardInterrupt:
            return time.perf_counter() - sent[0]
        finally:
            ended.set()
            sender.join()
        self.fail("the call ended by itself")

    def test_control_c_ends_every_long_method(self):
        # Each would take minutes.
        many = np.random.default_rng(0).random((60_000, 3))
        descriptors = np.random.default_rng(1).random((60_000, 33))
        few = terrain(2000)
        calls = {
            "cf": lambda: cfreg.register(many, many, "cf"),
            "cfk": lambda: cfreg.register(many, many, "cfk", detector={"sift": {"octaves": 8, "scales": 16}}),
            "gicp": lambda: cfreg.ICP.generalized(rotation_tolerance=0.0, translation_tolerance=0.0, max_iterations=10**6).register(
                many, many[::-1] + 0.3
            ),
            "kc": lambda: cfreg.KC(sigma=10.0).register(many, many),
            "cpd": lambda: cfreg.CPD(tolerance=1e-12, truncation=0.0).register(many, many + 0.1),
            "dare": lambda: cfreg.DARE(tolerance=1e-12, max_iterations=10**6).register(many, many + 0.1),
            "teaser": lambda: cfreg.TEASER(neighbors=10, noise_bound=0.5, cross_check=False, clique_steps=10**15).register(few, few[:, ::-1].copy()),
            "moments": lambda: cfreg.moments(many, many, descriptors, descriptors, normalize="sinkhorn:99", threads=2),
            "a nested call": lambda: cfreg.moments(
                few, few, few, few, weights=lambda d2: (cfreg.register(many, many, "cf"), d2)[1]
            ),
            "a function": lambda: cfreg.register(few, few, "cf", weights=lambda d2: (time.sleep(0.5), d2)[1]),
        }
        for name, call in calls.items():
            with self.subTest(name):
                self.assertLess(self.ended(call), 3.0)
        # And the next call is as if nothing had been.
        self.assertTrue(cfreg.register(few, few).trusted)

    def test_handlers_of_ones_own_run_and_the_call_goes_on(self):
        heard = []
        before = signal.signal(signal.SIGINT, lambda *_: heard.append(time.perf_counter()))
        try:
            timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
            timer.start()
            found = cfreg.register(terrain(500), terrain(500), "cf", weights=lambda d2: (time.sleep(0.2), d2 < 50)[1], threads=1)
            ended = time.perf_counter()
        finally:
            signal.signal(signal.SIGINT, before)
        self.assertEqual(len(heard), 1)
        self.assertLess(heard[0], ended)
        self.assertEqual(found.method, "cf")


def pose(seed):
    return cfreg.register(terrain(300, seed), terrain(300, seed + 1), "cf", neighbors=40).transform


class Processes(unittest.TestCase):
    @unittest.skipUnless(hasattr(os, "fork"), "there is no fork here")
    def test_a_forked_process_registers_too(self):
        """Its parent's threads are not there; waiting for them would never end."""
        program = (
            "import multiprocessing, test_running\n"
            "test_running.pose(0)\n"
            "with multiprocessing.get_context('fork').Pool(2) as pool:\n"
            "    poses = pool.map_async(test_running.pose, range(4)).get(timeout=100)\n"
            "assert all((a == test_running.pose(i)).all() for i, a in enumerate(poses))\n"
        )
        subprocess.run([sys.executable, "-c", program], check=True, timeout=120, cwd=Path(__file__).parent)

    def test_python_ends_whatever_its_daemons_do(self):
        program = (
            "import threading, time, numpy as np\n"
            "import atexit\n"
            "atexit.register(lambda: print(cfreg.fpfh(points, 20).shape))\n"  # the last to run
            "import cfreg\n"
            "points = np.random.default_rng(0).random((400, 3))\n"
            "def plain():\n"
            "    while True: cfreg.register(cfreg.PointCloud(points), points, 'cf', neighbors=20)\n"
            "def function():\n"
            "    while True: cfreg.moments(points, points, points, points, weights=lambda d2: np.exp(-d2))\n"
            "for work in [plain, function] * 2: threading.Thread(target=work, daemon=True).start()\n"
            "time.sleep(0.2)\n"
        )
        for _ in range(10):
            ended = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=60)
            self.assertEqual((ended.returncode, ended.stdout, ended.stderr), (0, b"(400, 33)\n", b""))

    def test_results_and_clouds_go_between_processes(self):
        cloud = cfreg.PointCloud(terrain(300))
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            found = pool.apply_async(cfreg.register, (cloud, cloud, "cf"), {"neighbors": 40}).get(timeout=100)
        self.assertEqual(found.to_dict()["transform"], cfreg.register(cloud, cloud, "cf", neighbors=40).to_dict()["transform"])


if __name__ == "__main__":
    unittest.main()
