"""Global registration by peers over a list of pairs, each moved at random: poses as CSV, which
`cfreg benchmark PAIRS.csv --poses POSES.csv` judges beside the crate's own.

    python -m peers.benchmark PAIRS.csv --folder DATA --output POSES.csv [--every N]
        [--only open3d-ransac,open3d-fgr,kiss-matcher,pcl-prerejective] [--origin]

The peers want a voxel size. They get one that suits each cloud: 4 mm for objects below a metre,
5 cm for rooms below 25 m, 0.5 m for streets. A run that was cut short goes on. PCL's is a program
of its own and tells its seconds itself; where it cannot be built it is left out.
"""

import argparse
import csv
from pathlib import Path

import numpy as np

from peers.programs import crate, kiss_matcher, open3d, pcl
from peers.timing import timed
from reference.rotations import from_quaternion
from reference.scans import read_pairs

TITLES = ["method", "source", "target", *(f"t{i}{j}" for i in range(4) for j in range(4)), "seconds", "accepted"]


def voxel(points, unit):
    """In the cloud's unit."""
    metres = np.linalg.norm(np.ptp(points, axis=0)) * unit
    return (0.004 if metres < 1.0 else 0.05 if metres < 25.0 else 0.5) / unit


def feature_cloud(points, sensor, size):
    """A cloud with its FPFH, Open3D's way: voxel grid, normals of two voxels, FPFH of five."""
    return open3d.feature_cloud(points, sensor, 2 * size, 30, 5 * size, 100, voxel=size)


def open3d_ransac(source, target, sensors, size):
    """FPFH and RANSAC of three, 100,000 iterations, as Open3D's tutorial has it."""
    open3d.seed(0)
    clouds = (feature_cloud(points, sensor, size) for points, sensor in zip((source, target), sensors))
    return open3d.ransac(*clouds, 1.5 * size), True


def open3d_fgr(source, target, sensors, size):
    """Fast global registration."""
    open3d.seed(0)
    clouds = (feature_cloud(points, sensor, size) for points, sensor in zip((source, target), sensors))
    return open3d.fast_global(*clouds, 1.5 * size), True


def by_kiss_matcher(source, target, _sensors, size):
    """KISS-Matcher by its defaults; it tells whether its answer is valid."""
    # It refuses voxels below 5 mm: small things are made larger.
    grown = max(1.0, 0.05 / size)
    pose, valid = kiss_matcher.register(source * grown, target * grown, size * grown)
    pose[:3, 3] /= grown
    return pose, valid


def pcl_prerejective(source, target, sensors, size):
    """PCL's prerejective sample consensus, which tells its own seconds."""
    pose, seconds = pcl.prerejective(source, target, sensors, size)
    return pose, pose is not None, seconds


PEERS = {
    "open3d-ransac": open3d_ransac,
    "open3d-fgr": open3d_fgr,
    "kiss-matcher": by_kiss_matcher,
    "pcl-prerejective": pcl_prerejective,
}


def motion(number, size):
    """Any rotation, and a shift of up to the size along each axis."""
    rng = np.random.default_rng(number)
    pose = np.eye(4)
    pose[:3, :3] = from_quaternion(rng.normal(size=4))
    pose[:3, 3] = size * rng.uniform(-1, 1, 3)
    return pose


def answer(name, ends, *given):
    """A peer's pose and whether it is accepted, or no pose after a line that says why."""
    try:
        return PEERS[name](*given)
    except RuntimeError as error:
        print(f"{name}: {ends[0]} -> {ends[1]}: {error}")
        return None, False


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pairs", type=Path)
    parser.add_argument("--folder", type=Path, help="of the files [default: that of the list]")
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--only", default=",".join(PEERS))
    parser.add_argument("--every", type=int, default=1, help="every N-th pair alone")
    parser.add_argument("--origin", action="store_true", help="sensors stand at the zero of each file")
    options = parser.parse_args()
    names = options.only.split(",")
    if "pcl-prerejective" in names and pcl.program("prerejective") is None:
        names.remove("pcl-prerejective")
    folder = options.folder or options.pairs.parent
    done = set()
    if options.output.exists():
        with open(options.output, newline="") as file:
            done = {(row["method"], row["source"], row["target"]) for row in csv.DictReader(file)}
    pairs = list(read_pairs(options.pairs))[:: options.every]
    clouds = {}
    with open(options.output, "a", newline="") as file:
        rows = csv.writer(file)
        if not done:
            rows.writerow(TITLES)
        for number, pair in enumerate(pairs):
            ends = [pair[end] for end in ("source", "target")]
            for end in ends:
                if end not in clouds:
                    clouds[end] = crate.read_points(folder / end)
            source, target = (clouds[end] for end in ends)
            size = voxel(source, {"cm": 0.01, "mm": 0.001}.get(pair.get("units"), 1.0))
            moved_by = motion(number, np.linalg.norm(np.ptp(source, axis=0)))
            moved = source @ moved_by[:3, :3].T + moved_by[:3, 3]
            sensors = [moved_by[:3, 3], np.zeros(3)]
            if not options.origin:
                sensors = [np.zeros(3), np.zeros(3)]  # as Open3D takes it where nothing is said
            for name in names:
                if (name, *ends) in done:
                    continue
                took, found = timed(lambda name=name: answer(name, ends, moved, target, sensors, size))
                pose, accepted, *own_seconds = found
                seconds = own_seconds[0] if own_seconds else took
                entries = [""] * 16 if pose is None else (pose @ moved_by).ravel().tolist()
                rows.writerow([name, *ends, *entries, seconds, str(accepted).lower()])
                file.flush()


if __name__ == "__main__":
    main()
