"""Global registration by peers over a list of pairs, each moved at random: poses as CSV, which
`cfreg benchmark PAIRS.csv --poses POSES.csv` judges beside the crate's own.

    python benchmark_peers.py PAIRS.csv --folder DATA --output POSES.csv [--every N]
        [--only open3d-ransac,open3d-fgr,kiss-matcher,pcl-prerejective] [--origin]

The peers want a voxel size. They get one that suits each cloud: 4 mm for objects below a metre,
5 cm for rooms below 25 m, 0.5 m for streets. A run that was cut short goes on. PCL's is a program
of its own and tells its seconds itself; where it cannot be built it is left out.
"""

import argparse
import csv
import time
from pathlib import Path

import cfreg
import numpy as np

from pcl import prerejective
from pcl.programs import program

TITLES = ["method", "source", "target", *(f"t{i}{j}" for i in range(4) for j in range(4)), "seconds", "accepted"]


def voxel(points, unit):
    """In the cloud's unit."""
    metres = np.linalg.norm(np.ptp(points, axis=0)) * unit
    return (0.004 if metres < 1.0 else 0.05 if metres < 25.0 else 0.5) / unit


def features(points, sensor, size):
    """Open3D's way: voxel grid, normals of two voxels, FPFH of five."""
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)).voxel_down_sample(size)
    hybrid = o3d.geometry.KDTreeSearchParamHybrid
    cloud.estimate_normals(hybrid(2 * size, 30))
    cloud.orient_normals_towards_camera_location(sensor)
    return cloud, o3d.pipelines.registration.compute_fpfh_feature(cloud, hybrid(5 * size, 100))


def open3d_ransac(source, target, sensors, size):
    """FPFH and RANSAC of three, 100,000 iterations, as Open3D's tutorial has it."""
    import open3d as o3d

    o3d.utility.random.seed(0)
    a, b = (features(points, sensor, size) for points, sensor in zip((source, target), sensors))
    return ransac(a, b, size), True


def ransac(a, b, size):
    """The pose between two clouds with their features."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    found = registration.registration_ransac_based_on_feature_matching(
        a[0],
        b[0],
        a[1],
        b[1],
        True,
        1.5 * size,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(1.5 * size),
        ],
        registration.RANSACConvergenceCriteria(100_000, 0.999),
    )
    return found.transformation


def open3d_fgr(source, target, sensors, size):
    """Fast global registration."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    o3d.utility.random.seed(0)
    a, b = (features(points, sensor, size) for points, sensor in zip((source, target), sensors))
    option = registration.FastGlobalRegistrationOption(maximum_correspondence_distance=1.5 * size)
    found = registration.registration_fgr_based_on_feature_matching(a[0], b[0], a[1], b[1], option)
    return found.transformation, True


def by_kiss_matcher(source, target, sensors, size):
    """KISS-Matcher by its defaults; it tells whether its answer is valid."""
    import kiss_matcher

    # It refuses voxels below 5 mm: small things are made larger.
    grown = max(1.0, 0.05 / size)
    matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(size * grown))
    found = matcher.estimate(source * grown, target * grown)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = found.rotation, np.asarray(found.translation) / grown
    return pose, bool(found.valid)


PEERS = {
    "open3d-ransac": open3d_ransac,
    "open3d-fgr": open3d_fgr,
    "kiss-matcher": by_kiss_matcher,
    "pcl-prerejective": prerejective.align,
}


def motion(number, size):
    """Any rotation, and a shift of up to the size along each axis."""
    rng = np.random.default_rng(number)
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = size * rng.uniform(-1, 1, 3)
    return pose


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
    if "pcl-prerejective" in names and program("prerejective") is None:
        names.remove("pcl-prerejective")
    folder = options.folder or options.pairs.parent
    done = set()
    if options.output.exists():
        with open(options.output, newline="") as file:
            done = {(row["method"], row["source"], row["target"]) for row in csv.DictReader(file)}
    with open(options.pairs, newline="") as file:
        pairs = list(csv.DictReader(file))[:: options.every]
    clouds = {}
    with open(options.output, "a", newline="") as file:
        rows = csv.writer(file)
        if not done:
            rows.writerow(TITLES)
        for number, pair in enumerate(pairs):
            ends = [pair[end] for end in ("source", "target")]
            for end in ends:
                if end not in clouds:
                    clouds[end] = np.asarray(cfreg.read(folder / end).points, dtype=np.float64)
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
                start = time.perf_counter()
                try:
                    pose, accepted, *told = PEERS[name](moved, target, sensors, size)
                except RuntimeError as error:
                    print(f"{name}: {ends[0]} -> {ends[1]}: {error}")
                    pose, accepted, told = None, False, []
                seconds = told[0] if told else time.perf_counter() - start
                entries = [""] * 16 if pose is None else (pose @ moved_by).ravel().tolist()
                rows.writerow([name, *ends, *entries, seconds, str(accepted).lower()])
                file.flush()


if __name__ == "__main__":
    main()
