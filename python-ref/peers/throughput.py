"""Pairs in bulk beside peers: how many a second, and whether memory stays flat.

    python -m peers.throughput FOLDER-OF-THE-SCANS [--points 500,5000,30000] [--threads 2] [--seconds 60]
        [--memory-pairs 100000] [--output TABLE.md]

Pairs are those of the Stanford scans in the folder's `pairs.csv`, downsampled at random and written as
PLY; a list has as many of them, in turn, as take about so many seconds. Each side reads the files.
Ours is `cfreg.register_batch` into Parquet, by `consensus` and by `cf`. Open3D's is a loop over the
pairs, its clouds and features kept in a dictionary, its own threads within: FPFH and RANSAC as in
`peers.benchmark`. KISS-Matcher's is a pool of one process a core, each held to its core. Voxels
of the peers are one and a half of the clouds' resolution, 4 mm at least. Right is a pose within 10
degrees and a twentieth of the size of the true one; the scans stand as they were taken, each sensor
at the zero of its file, which ours and Open3D's normals are told.
"""

import argparse
import multiprocessing
import os
import platform
import subprocess
import sys
import tempfile
from datetime import date
from pathlib import Path

import numpy as np

from peers import processors
from peers.benchmark import by_kiss_matcher, feature_cloud
from peers.printed import Transcript, rule_line, table_line
from peers.programs import open3d
from peers.timing import timed
from reference.pose_error import rotation_degrees
from reference.scans import read_pairs

SETS = ("stanford_bunny", "stanford_dragon_stand")
TITLES = ("points", "by", "pairs", "pairs/s", "pairs/s/core", "right")


def downsampled_pairs(data, points, folder):
    """Pairs of files with their true poses; the files, downsampled, are written into `folder`."""
    import cfreg

    pairs = []
    for row in read_pairs(data / "pairs.csv"):
        if row["dataset"] in SETS:
            names = [row[end].replace("/", "-") for end in ("source", "target")]
            pairs.append((*names, row["truth"]))
            for end, name in zip(("source", "target"), names):
                if not (folder / name).exists():
                    cfreg.write(folder / name, cfreg.read(data / row[end]).sample(points))
    return pairs


def is_right(pose, truth, size):
    shift = np.linalg.norm((pose - truth)[:3, 3])
    return rotation_degrees(pose, truth) < 10 and shift < size / 20


def by_consensus(folder, pairs, threads, method="consensus"):
    """Poses of the pairs, NaN without one."""
    import cfreg

    found = folder / "ours.parquet"
    names = [(source, target) for source, target, _ in pairs]
    how = {"folder": folder, "viewpoints": "origin", "threads": threads, "overwrite": True}
    cfreg.register_batch(names, method, output=found, **how)
    return list(cfreg.read_batch(found).transform)


def scan(folder, name):
    """Points, and the peers' voxel."""
    import cfreg

    cloud = cfreg.read(folder / name)
    return np.asarray(cloud.points, dtype=np.float64), max(0.004, 1.5 * cloud.resolution)


def by_open3d_loop(folder, pairs, _threads):
    """A loop, as one writes it."""
    open3d.seed(0)
    known = {}
    poses = []
    for source, target, _ in pairs:
        for name in (source, target):
            if name not in known:
                points, size = scan(folder, name)
                known[name] = feature_cloud(points, np.zeros(3), size), size
        (a, size), (b, other) = known[source], known[target]
        poses.append(open3d.ransac(a, b, 1.5 * max(size, other)))
    return poses


def one_by_kiss_matcher(job):
    folder, source, target = job
    (a, size), (b, other) = scan(folder, source), scan(folder, target)
    return by_kiss_matcher(a, b, None, max(size, other))[0]


def by_kiss_matcher_pool(folder, pairs, threads):
    """A pool of processes, begun within the time as that of the threads of the others is."""
    context = multiprocessing.get_context("spawn")
    cores = context.Queue()
    for core in sorted(os.sched_getaffinity(0))[:threads]:
        cores.put(core)
    jobs = [(folder, source, target) for source, target, _ in pairs]
    with context.Pool(threads, processors.hold_to, (cores,)) as pool:
        return list(pool.imap(one_by_kiss_matcher, jobs, chunksize=4))


def by_cf(folder, pairs, threads):
    return by_consensus(folder, pairs, threads, "cf")


SIDES = {
    "cfreg": by_consensus,
    "cfreg, cf": by_cf,
    "Open3D, loop": by_open3d_loop,
    "KISS-Matcher, pool": by_kiss_matcher_pool,
}


def pairs_a_second(side, folder, pairs, threads, seconds):
    """And the share that is right. A first round tells how many make the time."""
    size = max(np.linalg.norm(np.ptp(scan(folder, name)[0], axis=0)) for name in {pair[0] for pair in pairs})
    few = pairs[:: max(1, len(pairs) // 12)]
    took, _ = timed(lambda: SIDES[side](folder, few, threads))
    count = max(len(few), round(seconds * len(few) / took))
    # All pairs in turn, or as many spread evenly.
    step = max(1.0, len(pairs) / count)
    many = [pairs[int(number * step) % len(pairs)] for number in range(count)]
    took, poses = timed(lambda: SIDES[side](folder, many, threads))
    right = [is_right(pose, truth, size) for pose, (*_, truth) in zip(poses, many)]
    return len(many), len(many) / took, np.mean(right)


def busy(folder, pairs, threads):
    """Share of the threads' time that is within registrations, the rest being that of bulk."""
    import cfreg

    names = [(source, target) for source, target, _ in pairs]
    settings = {"folder": folder, "viewpoints": "origin", "threads": threads, "times": True}
    took, found = timed(lambda: cfreg.register_batch(names, **settings))
    return found["seconds"].sum() / (threads * took)


MEMORY = """
import sys, cfreg
folder, count = sys.argv[1], int(sys.argv[2])
names = sorted(__import__("os").listdir(folder))
names = [name for name in names if name.endswith(".ply")]
pairs = [(names[i % len(names)], names[(i * 7 + 1) % len(names)]) for i in range(count)]
held = []
def look(done, all):
    if done % max(1, all // 10) == 0:
        pages = int(open("/proc/self/statm").read().split()[1])
        held.append(pages * 4096 / 2**20)
cfreg.register_batch(pairs, "icp", folder=folder, output=folder + "/memory.parquet", memory=64 << 20, progress=look)
print(*(round(x) for x in held))
"""


def memory(folder, count):
    """MiB of the process at every tenth of a list of so many pairs by ICP, the first at none."""
    done = subprocess.run([sys.executable, "-c", MEMORY, str(folder), str(count)], capture_output=True, text=True, check=True)
    return [int(word) for word in done.stdout.split()]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--points", default="500,5000,30000")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--seconds", type=float, default=60.0, help="of each side, about")
    parser.add_argument("--memory-pairs", type=int, default=100_000)
    parser.add_argument("--output", type=Path, help="write the table there, too")
    options = parser.parse_args()
    processors.limit(options.threads)
    transcript = Transcript()
    load = os.getloadavg()[0]
    transcript.say(f"{date.today()}, {platform.machine()}, {options.threads} threads, load before {load:.2f}\n")
    transcript.say(table_line(TITLES))
    transcript.say(rule_line(len(TITLES)))
    shares = []
    with tempfile.TemporaryDirectory() as room:
        for points in map(int, options.points.split(",")):
            folder = Path(room, str(points))
            folder.mkdir()
            pairs = downsampled_pairs(options.data, points, folder)
            for side in SIDES:
                count, rate, right = pairs_a_second(side, folder, pairs, options.threads, options.seconds)
                rates = f"{rate:.2f}", f"{rate / options.threads:.2f}"
                transcript.say(table_line([points, side, count, *rates, f"{100 * right:.0f} %"]))
            shares.append(f"{100 * busy(folder, pairs[::4], options.threads):.1f} %")
        transcript.say(f"\nShare of the threads' time that is within registrations by consensus: {', '.join(shares)}")
        if options.memory_pairs:
            folder = Path(room, options.points.split(",")[0])
            held = memory(folder, options.memory_pairs)
            transcript.say(f"\nMiB held at every tenth of {options.memory_pairs} pairs: {', '.join(map(str, held))}")
    transcript.write(options.output)


if __name__ == "__main__":
    main()
