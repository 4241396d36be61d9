"""Pairs in bulk beside peers: how many a second, and whether memory stays flat.

    python throughput.py FOLDER-OF-THE-SCANS [--points 500,5000,30000] [--threads 2] [--seconds 60]
        [--memory-pairs 100000] [--output TABLE.md]

Pairs are those of the Stanford scans in the folder's `pairs.csv`, thinned at random and written as
PLY; a list has as many of them, in turn, as take about so many seconds. Each side reads the files.
Ours is `cfreg.register_batch` into Parquet, by `consensus` and by `cf`. Open3D's is a loop over the
pairs, its clouds and features kept in a dictionary, its own threads within: FPFH and RANSAC as in
`benchmark_peers.py`. KISS-Matcher's is a pool of one process a core, each held to its core. Voxels
of the peers are one and a half of the clouds' resolution, 4 mm at least. Right is a pose within 10
degrees and a twentieth of the size of the true one; the scans stand as they were taken, each sensor
at the zero of its file, which ours and Open3D's normals are told.
"""

import argparse
import csv
import multiprocessing
import os
import platform
import subprocess
import sys
import tempfile
import time
from datetime import date
from pathlib import Path

import numpy as np

SETS = ("stanford_bunny", "stanford_dragon_stand")


def thinned(data, points, folder):
    """Pairs of files with their true poses; the files, thinned, are written into `folder`."""
    import cfreg

    pairs = []
    with open(data / "pairs.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["dataset"] in SETS:
                names = [row[end].replace("/", "-") for end in ("source", "target")]
                truth = np.array([float(row[f"t{i}{j}"]) for i in range(4) for j in range(4)])
                pairs.append((*names, truth.reshape(4, 4)))
                for end, name in zip(("source", "target"), names):
                    if not (folder / name).exists():
                        cfreg.write(folder / name, cfreg.read(data / row[end]).sample(points))
    return pairs


def is_right(pose, truth, size):
    off = np.linalg.inv(truth) @ pose
    angle = np.degrees(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1)))
    return angle < 10 and np.linalg.norm(off[:3, 3]) < size / 20


def ours(folder, pairs, threads, method="consensus"):
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


def by_open3d(folder, pairs, _threads):
    """A loop, as one writes it."""
    import open3d as o3d

    from benchmark_peers import features, ransac

    o3d.utility.random.seed(0)
    known = {}
    poses = []
    for source, target, _ in pairs:
        for name in (source, target):
            if name not in known:
                points, size = scan(folder, name)
                known[name] = (*features(points, np.zeros(3), size), size)
        size = max(known[source][2], known[target][2])
        poses.append(ransac(known[source][:2], known[target][:2], size))
    return poses


def hold(cores):
    """Holds a process of the pool to a core of its own."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {cores.get()})


def one_by_kiss_matcher(job):
    from benchmark_peers import by_kiss_matcher

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
    with context.Pool(threads, hold, (cores,)) as pool:
        return list(pool.imap(one_by_kiss_matcher, jobs, chunksize=4))


def ours_by_cf(folder, pairs, threads):
    return ours(folder, pairs, threads, "cf")


SIDES = {"cfreg": ours, "cfreg, cf": ours_by_cf, "Open3D, loop": by_open3d, "KISS-Matcher, pool": by_kiss_matcher_pool}


def pairs_a_second(side, folder, pairs, threads, seconds):
    """And the share that is right. A first round tells how many make the time."""
    size = max(np.linalg.norm(np.ptp(scan(folder, name)[0], axis=0)) for name in {pair[0] for pair in pairs})
    few = pairs[:: max(1, len(pairs) // 12)]
    begun = time.perf_counter()
    SIDES[side](folder, few, threads)
    count = max(len(few), round(seconds * len(few) / (time.perf_counter() - begun)))
    # All pairs in turn, or as many spread evenly.
    step = max(1.0, len(pairs) / count)
    many = [pairs[int(number * step) % len(pairs)] for number in range(count)]
    begun = time.perf_counter()
    poses = SIDES[side](folder, many, threads)
    took = time.perf_counter() - begun
    right = [is_right(pose, truth, size) for pose, (*_, truth) in zip(poses, many)]
    return len(many), len(many) / took, np.mean(right)


def busy(folder, pairs, threads):
    """Share of the threads' time that is within registrations, the rest being that of bulk."""
    import cfreg

    names = [(source, target) for source, target, _ in pairs]
    begun = time.perf_counter()
    found = cfreg.register_batch(names, folder=folder, viewpoints="origin", threads=threads, times=True)
    return found["seconds"].sum() / (threads * (time.perf_counter() - begun))


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
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.threads])
    lines = []

    def say(line):
        print(line, flush=True)
        lines.append(line)

    load = os.getloadavg()[0]
    say(f"{date.today()}, {platform.machine()}, {options.threads} threads, load before {load:.2f}\n")
    say("| points | by | pairs | pairs/s | pairs/s/core | right |")
    say("|---|---|---|---|---|---|")
    shares = []
    with tempfile.TemporaryDirectory() as room:
        for points in map(int, options.points.split(",")):
            folder = Path(room, str(points))
            folder.mkdir()
            pairs = thinned(options.data, points, folder)
            for side in SIDES:
                count, rate, right = pairs_a_second(side, folder, pairs, options.threads, options.seconds)
                per_core = rate / options.threads
                say(f"| {points} | {side} | {count} | {rate:.2f} | {per_core:.2f} | {100 * right:.0f} % |")
            shares.append(f"{100 * busy(folder, pairs[::4], options.threads):.1f} %")
        say(f"\nOf the threads' time, within registrations by consensus: {', '.join(shares)}")
        if options.memory_pairs:
            folder = Path(room, options.points.split(",")[0])
            held = memory(folder, options.memory_pairs)
            say(f"\nMiB held at every tenth of {options.memory_pairs} pairs: {', '.join(map(str, held))}")
    if options.output:
        options.output.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
