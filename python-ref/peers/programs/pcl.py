"""PCL, by the C++ programs of the folder `pcl`, which are built where PCL is installed (Debian:
libpcl-dev, cmake, g++). Clouds go to them as text, one point a line."""

import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from peers.programs import REPOSITORY

SOURCES = REPOSITORY / "python-ref" / "pcl"
BUILD = REPOSITORY / "target" / "pcl"


def build(name):
    """Path of the program `name`, or None where there is no CMake, no compiler or no PCL."""
    if shutil.which("cmake") is None:
        return None
    configured = subprocess.run(
        ["cmake", "-S", str(SOURCES), "-B", str(BUILD)], capture_output=True, text=True
    )
    if configured.returncode != 0:
        if any(missing in configured.stderr for missing in ("PCLConfig.cmake", "CMAKE_CXX_COMPILER")):
            return None
        sys.exit(f"CMake failed:\n{configured.stderr}")
    command = ["cmake", "--build", str(BUILD), "--target", name]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return BUILD / name


@cache
def program(name):
    """The same, and None after a line that says what is left out."""
    path = build(name)
    if path is None:
        print(f"left out: PCL's {name} (libpcl-dev, cmake or g++ is not installed)")
    return path


def run(name, *arguments):
    """Runs the program and returns the text that it prints."""
    command = [program(name), *map(as_word, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"PCL's {name} failed:\n{done.stderr}")
    return done.stdout


def as_word(argument):
    """An argument as text: floats with all their digits."""
    return repr(float(argument)) if isinstance(argument, float) else str(argument)


def save(path, points):
    """Writes one point a line, f32 numbers with all their digits."""
    np.savetxt(path, points, fmt="%.9g")
    return path


def described_points(points, k, sift=None):
    """Places (n, 3) and descriptors (n, 33) of all points, or of the keypoints of `sift`:
    smallest scale in the unit of the points, octaves, scales, least contrast; normals of k
    neighbours, on the origin's side. And the seconds that normals and descriptors took."""
    with tempfile.TemporaryDirectory() as folder:
        cloud, out = save(Path(folder) / "cloud", points), Path(folder) / "out"
        seconds = run("described_points", cloud, out, k, *(sift or ()))
        rows = np.loadtxt(out, ndmin=2) if out.stat().st_size else np.empty((0, 36))
    return rows[:, :3], rows[:, 3:], float(seconds)


def features(points, normals, k):
    """Its own normals (N, 3) and curvatures (N,), and FPFH (N, 33) from the given normals."""
    with tempfile.TemporaryDirectory() as folder:
        cloud, oriented, histograms = (Path(folder) / name for name in ("cloud", "normals", "fpfh"))
        save(cloud, np.hstack([points, normals]))
        run("export_features", cloud, k, oriented, histograms)
        rows = np.loadtxt(oriented)
        return rows[:, :3], rows[:, 3], np.loadtxt(histograms)


def keypoints(points, values, detector, settings):
    """Rows of the keypoints by `sift` (place and scale) or `iss` (index), and for `sift` the
    octave, place and value of each point that the octaves keep."""
    with tempfile.TemporaryDirectory() as folder:
        cloud, out, stages = (Path(folder) / name for name in ("cloud", "out", "stages"))
        save(cloud, np.column_stack([points, values]))
        run("keypoints", cloud, out, stages, detector, *settings)
        kept = np.loadtxt(stages, ndmin=2) if stages.exists() else None
        return np.loadtxt(out, ndmin=2), kept


def iterative_closest_point(pairs, settings):
    """Poses and iterations of many pairs of clouds; `settings` are words."""
    with tempfile.TemporaryDirectory() as folder:
        lines = []
        for number, clouds in enumerate(pairs):
            names = [Path(folder) / f"{number}{side}" for side in "ab"]
            lines.append(" ".join(str(save(name, points)) for name, points in zip(names, clouds)))
        listed = Path(folder) / "pairs"
        listed.write_text("\n".join(lines) + "\n")
        printed = run("icp", listed, *settings)
    rows = np.array([[float(x) for x in line.split()] for line in printed.splitlines()])
    return list(rows[:, :16].reshape(-1, 4, 4)), rows[:, 16]


def prerejective(source, target, sensors, voxel):
    """Pose by prerejective sample consensus, or None where too few points would meet, and the
    seconds that it took, without files and the start of the program."""
    with tempfile.TemporaryDirectory() as folder:
        names = [Path(folder) / side for side in ("source", "target")]
        files = [save(name, points) for name, points in zip(names, (source, target))]
        numbers = map(float, (voxel, *sensors[0], *sensors[1]))
        printed = run("prerejective", *files, *numbers)
    seconds, *entries = map(float, printed.split())
    return (np.reshape(entries, (4, 4)) if entries else None), seconds
