"""From two clouds to a pose, one large pair and many small ones; memory."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import cfreg
import numpy as np

from peers.programs import open3d, pose_from
from peers.speed import row
from peers.speed.features import NEIGHBORS
from peers.speed.moments import numpy_sums
from peers.speed.samples import samples
from peers.timing import shortest
from reference.pose_error import rotation_degrees

BETA = 400.0  # on Open3D's scale
TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
PAIRS = 100


def rows(options):
    yield from large(options)
    yield small(options)
    yield memory()


def large(options):
    source, target = samples(options.points)
    target = np.ascontiguousarray(target @ TURN.T.astype(np.float32))
    method = cfreg.CF(histogram="open3d", threads=options.threads)
    within = cfreg.CF(histogram="open3d", threads=options.threads, tolerance=1e-3)
    (dense, skipping, peer), (found, near, theirs) = shortest(
        lambda: method.register(source, target),
        lambda: within.register(source, target),
        lambda: by_open3d_and_numpy(source, target),
    )
    what = f"two clouds of {len(source)} to a pose, judged"
    for what, own, answer in ((what, dense, found), (f"{what}, within 1e-3", skipping, near)):
        same = f"{rotation_degrees(answer.transform, theirs):.0e} deg apart"
        yield row(what, own, peer, "Open3D features + numpy CF", same)


def small(options):
    clouds = [samples(500)[0]] + [samples(500 + at)[1][:500] for at in range(1, 8)]
    clouds = [cfreg.PointCloud(cloud) for cloud in clouds]
    pairs = [(clouds[at % 8], clouds[(3 * at + 1) % 8]) for at in range(PAIRS)]

    def ours():
        with ThreadPoolExecutor(options.threads) as pool:
            call = lambda pair: cfreg.register(*pair, "cf", threads=1, histogram="open3d")
            return list(pool.map(call, pairs))

    def theirs():
        arrays = [np.asarray(cloud.points, np.float32) for cloud in clouds]
        for at in range(PAIRS // 10):
            by_open3d_and_numpy(arrays[at % 8], arrays[(3 * at + 1) % 8])

    (own, other), _ = shortest(ours, theirs)
    own, other = own / PAIRS, other / (PAIRS // 10)
    return row("a pair of 500 points", own, other, "Open3D features + numpy CF", f"{1 / own:.0f} pairs/s")


def memory():
    program = (
        "import numpy as np, cfreg\n"
        "from pathlib import Path\n"
        "def peak():\n"
        "    lines = Path('/proc/self/status').read_text().splitlines()\n"
        "    return next(int(line.split()[1]) // 1024 for line in lines if line.startswith('VmHWM'))\n"
        "x, y = np.random.default_rng(0).uniform(-1, 1, (2, 100_000)).astype(np.float32)\n"
        "points = np.column_stack([x, y, 0.3 * np.sin(3 * x + y) + 0.1 * np.cos(9 * y) * x - 3])\n"
        "before = peak()\n"
        "cfreg.register(points, points, 'cf', tolerance=1e-3)\n"
        "print(before, peak())\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    before, peak = done.stdout.split()
    return f"two clouds of 100000: peak memory {peak} MB, {before} of it Python with the clouds"


def by_open3d_and_numpy(source, target):
    """The paper's method by the parts that Python has: a pose (4, 4)."""
    own, other = (
        open3d.fpfh_seen_from(cloud.astype(np.float64), NEIGHBORS, np.zeros(3)).astype(np.float32)
        for cloud in (source, target)
    )
    p0, q0 = source.mean(axis=0), target.mean(axis=0)
    weight, p, q, cross = numpy_sums(source - p0, target - q0, own, other, BETA)
    u, _, vt = np.linalg.svd(cross - np.outer(p, q) / weight)
    turn = vt.T @ np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
    return pose_from(turn, q0 + q / weight - turn @ (p0 + p / weight))
