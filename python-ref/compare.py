"""The crate's Python module, the reference and Open3D on the same clouds.

    python compare.py                   all three
    python compare.py --without-cfreg   the reference and Open3D only

Prints one table of differences, stage by stage, and exits with 1 and the names of
those above their bound. Clouds are real scans where there are any (CFREG_DATA, else
../shared/data beside the repository), procedural reliefs elsewhere.
"""

import argparse
import importlib
import sys

import reference as ref
import scans
import stages
from surfaces import as_f32

BOUNDS = {
    "normal angle, median, degrees": (1e-4, "f32 normals: a rounding is 3e-6 degrees"),
    "normal angle, max, degrees": (0.05, "the same, up to 1000 times by close eigenvalues"),
    "curvature, max": (1e-5, "f32 eigenvalues of a covariance"),
    "FPFH pcl, L1 of 300, median": (0.01, "the same pairs in the same bins, summed in f32"),
    "FPFH open3d, L1 of 600, median": (0.01, "the same pairs in the same bins, summed in f32"),
    "FPFH pcl, share of points > 1": (1e-3, "few pairs lie within f32 rounding of an edge"),
    "FPFH open3d, share of points > 1": (1e-3, "few pairs lie within f32 rounding of an edge"),
    "FPFH pcl from own normals, L1 of 300, median": (0.05, "f32 normals differ in the last bit"),
    "sum of weights, relative": (5e-5, "d² of 33 bins in f32 is off by 1e-3, beta is 100"),
    "sum of squared weights, relative": (1e-4, "twice that of the weights"),
    "moments, relative to size": (5e-5, "weights as above, sums in f64"),
    "truncated: change of a sum per pair in doubt": (1.0, "such a pair weighs 0 or 1"),
    "pose from equal moments, difference": (1e-9, "closed forms in f64 on both sides"),
    "pose, rotation, degrees": (1e-3, "moments as above: 5e-5 at the very worst, in part a factor"),
    "pose, translation / size": (2e-5, "moments as above, in part a common factor"),
    "register, rotation, degrees": (0.05, "pairs in other bins: equal normals, ties, edges"),
    "register, translation / size": (5e-4, "pairs in other bins: equal normals, ties, edges"),
}
"""The greatest difference allowed, and why it may be that large."""

SCANS = ((scans.BUNNY, 5000), (scans.DRAGON, 2000), (scans.ROOM, 3000))
RELIEFS = (3000, 500)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--without-cfreg", action="store_true", help="leave the crate out")
    arguments.add_argument("--points", type=int, default=None, help="at most so many a cloud")
    options = arguments.parse_args()
    cfreg = None if options.without_cfreg else load_cfreg()
    print(f"{'quantity':57} {'value':>9} {'at most':>8}  who")
    exceeded = []
    for pair in pairs(options.points or sys.maxsize):
        print(f"\n{pair.name}, k = {ref.NEIGHBORS}, beta = {ref.BETA:g}")
        for quantity, value, who in worst_first_seen(measured(pair, cfreg)):
            bound, reason = BOUNDS.get(quantity, (None, None))
            limit = "" if bound is None else f"{bound:.0e}"
            print(f"{quantity:57} {value:9.2e} {limit:>8}  {who}")
            if bound is not None and not value <= bound:
                exceeded.append(
                    f"{pair.name}: {quantity} is {value:.3g}, at most {bound:g} ({reason}): {who}"
                )
    print()
    for line in exceeded:
        print("exceeded:", line)
    if not exceeded:
        print("every difference is within its bound")
    return 1 if exceeded else 0


def load_cfreg():
    try:
        return importlib.import_module("cfreg")
    except ImportError as error:
        sys.exit(f"{error}: build the crate's module first, or use --without-cfreg")


def pairs(most):
    """The clouds of this run: `most` limits their sizes."""
    if scans.data_folder() is None:
        print("no scans (CFREG_DATA and ../shared/data are absent): procedural reliefs instead")
        for seed, count in enumerate(RELIEFS):
            yield scans.relief_pair(min(count, most), seed)
        return
    for seed, (name, count) in enumerate(SCANS):
        yield scans.scan_pair(name, min(count, most), seed)
    yield scans.relief_pair(min(RELIEFS[-1], most), len(SCANS))


def measured(pair, cfreg):
    """All (quantity, who, value) of a pair, in the order of the pipeline."""
    source = stages.scene(pair.source, pair.source_viewpoint, ref.NEIGHBORS)
    target = stages.scene(pair.target, pair.target_viewpoint, ref.NEIGHBORS)
    for s in (source, target):
        yield from stages.ties(s)
        yield from stages.normals(s, cfreg)
        yield from stages.descriptors(s, cfreg)
    if cfreg:
        yield from stages.sums(source, target, pair.size(), cfreg, ref.BETA)
        # Only rotated about the viewpoint, the default one of both sides.
        turned = as_f32(pair.target - pair.translation)
        yield from stages.registration(pair.source, turned, pair.size(), cfreg, ref.BETA)


def worst_first_seen(rows):
    """Per quantity and pair of implementations only the worst (quantity, value, who),
    in order of first appearance: source and target, and all schemes, share a line."""
    worst = {}
    for quantity, who, value in rows:
        key = quantity, who.split(",")[0]
        if key not in worst or not value <= worst[key][0]:
            worst[key] = (value, who)
    for (quantity, _), (value, who) in sorted_by_quantity(worst):
        yield quantity, float(value), who


def sorted_by_quantity(worst):
    """Lines of one quantity together, quantities as first seen."""
    order = {}
    for quantity, _ in worst:
        order.setdefault(quantity, len(order))
    return sorted(worst.items(), key=lambda entry: order[entry[0][0]])


if __name__ == "__main__":
    sys.exit(main())
