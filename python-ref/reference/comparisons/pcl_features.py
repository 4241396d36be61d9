"""The reference, and the crate where it is importable, beside PCL's own features.

Builds `export_features` with CMake where PCL is installed, runs it on a sample of a
real scan and on the same sample with coinciding points and degenerate pairs, and
prints what differs. Exit code 1 when a bound is exceeded, 0 when PCL is missing.

    python -m reference.comparisons.pcl_features [--points 5000] [--neighbors 150]
"""

import argparse
import importlib
import sys

import numpy as np

import reference as ref
from peers.programs import is_installed, pcl
from reference import scans
from reference.comparisons.features import TIE, angles
from reference.surfaces import VIEWPOINT, as_f32, relief

SEED = 2009

BOUNDS = {
    "normal angle, median, degrees": (1e-4, "PCL's covariances are sums in f32"),
    "normal angle, max, degrees": (0.01, "the same where two eigenvalues are close"),
    "curvature, max": (1e-5, "PCL's covariances are sums in f32"),
    "FPFH L1 of 300, median": (1e-3, "the same pairs in the same bins, summed in f32"),
    "FPFH share of points differing by > 1": (1e-3, "few pairs lie at the edge of a bin in f32"),
}
"""The greatest difference allowed, and the reason."""


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--points", type=int, default=5000)
    arguments.add_argument("--neighbors", type=int, default=ref.NEIGHBORS)
    options = arguments.parse_args()
    if pcl.program("export_features") is None:
        return 0
    exceeded = []
    for name, points, normals in clouds(options.points, options.neighbors):
        print(f"{name}: {len(points)} points, k = {options.neighbors}")
        theirs = pcl.features(points, normals, options.neighbors)
        exceeded += report(points, normals, options.neighbors, *theirs)
    for line in exceeded:
        print("exceeded:", line)
    return 1 if exceeded else 0


def clouds(count, k):
    """Name, points and f32 normals of each cloud to compare."""
    rng = np.random.default_rng(SEED)
    if scans.data_folder() is None:
        print("no scans found (CFREG_DATA, ../shared/data): a procedural relief instead")
        points = relief(count, rng) - VIEWPOINT
        name = "relief"
    else:
        points = scans.sample(scans.scan(scans.BUNNY), count, rng)
        name = scans.BUNNY
    points = as_f32(points)
    normals = as_f32(ref.normals(points, k)[0])
    yield name, points, normals
    yield f"{name} with degenerate pairs", *with_degenerate_pairs(points, normals)


def with_degenerate_pairs(points, normals):
    """The cloud with every tenth point twice, and every next to a tenth repeated a step
    along z with both normals on the line between the two, so that d x u is exactly 0."""
    twice, along = np.arange(0, len(points), 10), np.arange(1, len(points), 10)
    normals = normals.copy()
    normals[along] = [0.0, 0.0, 1.0]
    above = as_f32(points[along] + [0.0, 0.0, 0.01 * np.ptp(points)])
    return np.vstack([points, points[twice], above]), np.vstack(
        [normals, normals[twice], normals[along]]
    )


def report(points, given_normals, k, normals, curvature, histograms):
    """Print the differences from PCL; the bounds exceeded, one line each."""
    decided = ref.separation(points, k) > TIE
    wholly = decided & decided[ref.nearest(points, k)[0]].all(axis=1)
    print(f"  points without a tie for the last neighbour: {decided.mean():.2%}")
    print(f"  and none among their neighbours either: {wholly.mean():.2%}")
    exceeded = []
    for who, implementation in implementations().items():
        found, bent, described = implementation(points, given_normals, k)
        angle = angles(found, normals)
        # Where the viewpoint lies in the tangent plane, rounding decides the side.
        flipped = angle > 90.0
        angle = np.minimum(angle, 180.0 - angle)
        apart = np.abs(described - histograms).sum(axis=1)
        rows = {
            "normal angle, median, degrees": np.median(angle[decided]),
            "normal angle, max, degrees": angle[decided].max(),
            "normals turned to the other side": int(flipped[decided].sum()),
            "curvature, median": np.median(np.abs(bent - curvature)[decided]),
            "curvature, max": np.abs(bent - curvature)[decided].max(),
            "FPFH L1 of 300, median": np.median(apart[decided]),
            "FPFH L1 of 300, max without any tie": apart[wholly].max() if wholly.any() else np.nan,
            "FPFH L1 of 300, max": apart[decided].max(),
            "FPFH L1 of 300, max with ties": apart.max(),
            "FPFH share of points differing by > 1": (apart[decided] > 1.0).mean(),
        }
        for what, value in rows.items():
            bound, _ = BOUNDS.get(what, (None, ""))
            limit = "" if bound is None else f"   (at most {bound:g})"
            print(f"  {who:9} - PCL   {what:40} {value:10.3g}{limit}")
            if bound is not None and not value <= bound:
                exceeded.append(f"{who}: {what} is {value:.3g}, at most {bound:g}")
    return exceeded


def implementations():
    """Who is compared: functions to normals, curvatures and FPFH from given normals."""
    found = {"reference": lambda p, n, k: (*ref.normals(p, k), ref.fpfh(p, n, k, "pcl"))}
    if is_installed("cfreg"):
        cfreg = importlib.import_module("cfreg")
        found["cfreg"] = lambda p, n, k: (
            *cfreg.estimate_normals(p, neighbors=k, viewpoint=(0.0, 0.0, 0.0)),
            cfreg.fpfh(p, neighbors=k, scale="pcl", normals=n),
        )
    return found


if __name__ == "__main__":
    sys.exit(main())
