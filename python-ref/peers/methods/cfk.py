"""CFK beside the way the paper computed it, and the keypoints beside PCL's and Open3D's.

PCL's SIFT puts its grid elsewhere (at the origin of the file), keeps the mean of a voxel
where the crate takes the point nearest to it, and lists an extremum once a scale, so that
some count several times. Single poses differ by that; over a protocol ours must not be
worse.
"""

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import reference as ref
from peers.methods import paper_pipeline, rule_table
from peers.methods.cf import by_crate, compared, error, of_all_tests
from peers.programs import open3d, pcl
from reference import scans
from reference.keypoints import sift_octaves
from reference.surfaces import as_f32

SIFT = {"min_scale": 0.5, "octaves": 4, "scales": 8, "min_contrast": 0.0}
OTHER_SCALES = tuple(
    {"min_scale": min_scale, "octaves": octaves, "scales": scales}
    for min_scale, octaves, scales in ((1.0, 3, 4), (1.0, 4, 16), (0.25, 5, 8))
)
"""Choices beside the default, coarser and finer."""
ISS = {"salient_radius": 6.0, "non_max_radius": 4.0, "gamma21": 0.975, "gamma32": 0.975}
MIN_NEIGHBORS = 5

SCANS = {
    scans.BUNNY: None,
    scans.DRAGON: None,
    "kitti00/000000.ply": 20_000,
    scans.ROOM: None,
}
"""Whose keypoints are compared, and of how many of their points."""


def rows(scope):
    if scans.data_folder() is None:
        print("left out: keypoints and CFK (CFREG_DATA and ../shared/data are absent)")
        return
    for name, points in SCANS.items():
        points = 2_000 if scope.smoke else points
        cloud = scans.scan(name)
        cloud = scans.sample(cloud, points or len(cloud), np.random.default_rng(0))
        yield from keypoints(f"{Path(name).stem}, {len(cloud)} points", cloud)
    if pcl.program("keypoints") is not None:
        for name in (scans.BUNNY, scans.DRAGON):
            cloud = scans.sample(scans.scan(name), 1_000 if scope.smoke else 5_000, np.random.default_rng(0))
            yield from octaves(f"{Path(name).stem}, {len(cloud)} points", cloud)
    pairs_of = list(of_all_tests(1 if scope.smoke else 40))
    for name, pairs in pairs_of:
        yield from beside_all_points(name, pairs[::3])
    if pcl.program("described_points") is None:
        return
    mine = by_crate("cfk", detector={"sift": SIFT})
    yield from compared("cfk", pairs_of, mine, published, judged=not scope.smoke)


def beside_all_points(name, pairs):
    """The evidence for the default scales: what each choice of them costs beside CF."""
    cf = answers(pairs, by_crate("cf"))[0]
    for choice in (SIFT, *OTHER_SCALES):
        errors, points = answers(pairs, by_crate("cfk", detector={"sift": choice}))
        scales = [choice[key] for key in ("min_scale", "octaves", "scales")]
        what = f"{points:.0f} keypoints of {scales}: median"
        yield rule_table.figures("cfk", "cf of all points", name, what, np.median(errors), np.median(cf))


def answers(pairs, answer):
    """Errors of the pairs, infinite where there is no answer, and the mean number of points
    that were connected."""
    found = [answer(pair) for pair in pairs]
    errors = [np.inf if pose is None else error(p.kind, pose, p) for p, (pose, _) in zip(pairs, found)]
    return errors, np.mean([counts for _, counts in found])


def published(pair):
    """PCL's keypoints with the same settings: its scales are in the unit of the cloud."""
    sifts = [
        (SIFT["min_scale"] * resolution(cloud), *list(SIFT.values())[1:])
        for cloud in (pair.source, pair.target)
    ]
    return paper_pipeline.pose(pair.source, pair.target, sifts=sifts)


def resolution(cloud):
    """Median distance to the nearest other point."""
    return float(np.median(cKDTree(cloud).query(cloud, 2)[0][:, 1]))


# --- keypoints by themselves ---------------------------------------------------------


def keypoints(name, cloud):
    """SIFT beside PCL's, with both grids from the same corner and where they happen to lie;
    ISS beside Open3D's and PCL's."""
    import cfreg

    _, curvature = cfreg.estimate_normals(cloud)
    unit = resolution(cloud)
    # PCL's grid starts at the origin, the crate's at the lowest corner.
    at_origin = as_f32(cloud - cloud.min(axis=0))
    if pcl.program("keypoints") is not None:
        for where, moved in (("one grid", at_origin), ("other grid", cloud)):
            found = cfreg.keypoints(moved, values=curvature, unit=unit, **SIFT)
            settings = (SIFT["min_scale"] * unit, *list(SIFT.values())[1:])
            theirs = sift_by_pcl(moved, curvature, settings)[0][:, :3]
            least = 0.99 if where == "one grid" else None
            yield agreement("PCL SIFT", name, where, shared_places(moved, found, theirs), least)
    found = cfreg.keypoints(cloud, "iss", unit=unit, min_neighbors=MIN_NEIGHBORS, **ISS)
    theirs = iss_by_open3d(cloud, unit)
    # The crate keeps all points with the same neighbourhood, Open3D those that rounding
    # prefers: where points stand in clusters the crate has a few more.
    yield agreement("Open3D ISS", name, "ISS", shared_places(cloud, found, theirs), 0.98)
    if pcl.program("keypoints") is not None:
        theirs = at_origin[iss_by_pcl(at_origin, curvature, unit)]
        yield agreement("PCL ISS", name, "ISS", shared_places(at_origin, found, theirs), None)


def shared_places(cloud, found, theirs):
    """How many keypoints either finds, and the share of theirs that are ours too. PCL gives
    means of a voxel: two points of the cloud may be equally near, and either will do."""
    theirs = np.unique(theirs, axis=0)
    nearest, indices = cKDTree(cloud).query(theirs)
    ours_at = cKDTree(cloud[found]).query(theirs)[0]
    slack = 1e-3 * nearest + 1e-6 * np.ptp(cloud)
    return len(found), len(np.unique(indices)), float((ours_at <= nearest + slack).mean())


def octaves(name, cloud):
    """Where the reference and PCL part: with PCL's grid, from the origin, nowhere; with one
    from the lowest corner in the downsampled clouds, and there alone, the more the coarser."""
    curvature = as_f32(ref.normals(cloud)[1])
    scale = float(np.float32(resolution(cloud)))
    settings = (scale, 3, 4, 0.0)
    places, stages = sift_by_pcl(cloud, curvature, settings)
    for where, corner in (("0", np.zeros(3)), ("corner", None)):
        found = sift_octaves(cloud, curvature, *settings, corner)
        for octave, (thin, _, keys) in enumerate(found):
            theirs = stages[stages[:, 0] == octave, 1:4]
            # The scale of an extremum is at least its octave's first.
            in_octave = np.floor(np.log2(places[:, 3] / scale) + 1e-3) == octave
            shares = common(thin, theirs), common(thin[keys], places[in_octave, :3])
            quantity = f"octave {octave}, {where}: thinned, keys"
            shown = f"{shares[0]:.3f}, {shares[1]:.3f}"
            rule = "" if corner is None else "shares at least 0.99"
            holds = corner is None or min(shares) >= 0.99
            yield rule_table.Row("cfk", "reference - PCL SIFT", name, quantity, shown, rule, holds)


def common(a, b):
    """Share of the larger set of places that are in the other too."""
    a, b = np.unique(a, axis=0), np.unique(b, axis=0)
    both = (cKDTree(b).query(a)[0] <= 1e-5 * np.ptp(a)).sum()
    return both / max(len(a), len(b))


def agreement(peer, clouds_of, what, numbers, least):
    """A row; the numbers of keypoints may differ by as little as their places."""
    mine, theirs, share = numbers
    rule, holds = "", True
    if least is not None:
        rule = f"share and numbers at least {least}"
        holds = share >= least and min(mine, theirs) >= least * max(mine, theirs)
    found = f"{mine} | {theirs}, {share:.3f}"
    return rule_table.Row("cfk", peer, clouds_of, f"{what}: found, share", found, rule, holds)


def sift_by_pcl(cloud, values, settings):
    """Places and scales (n, 4), and the octave, place and value of each thinned point."""
    return pcl.keypoints(cloud, values, "sift", settings)


def iss_by_pcl(cloud, values, unit):
    """Indices (n,)."""
    lengths = [ISS["salient_radius"] * unit, ISS["non_max_radius"] * unit]
    settings = [*lengths, ISS["gamma21"], ISS["gamma32"], MIN_NEIGHBORS]
    return pcl.keypoints(cloud, values, "iss", settings)[0][:, 0].astype(int)


def iss_by_open3d(cloud, unit):
    """Places (n, 3)."""
    lengths = [ISS["salient_radius"] * unit, ISS["non_max_radius"] * unit]
    return open3d.iss(cloud, *lengths, ISS["gamma21"], ISS["gamma32"], MIN_NEIGHBORS)
