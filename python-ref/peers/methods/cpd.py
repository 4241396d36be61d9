"""Coherent Point Drift beside pycpd and probreg.

Both peers get the clouds in root mean square radii of the target, as the authors' program
normalises and the crate does inside: the density of their outlier part, their tolerances
and probreg's floor of sigma² have a unit. pycpd always estimates a scale. The
variant of probreg with scale is the published one; without, its sigma² adds
tr(Y'^T d(P1) Y') - tr(A^T R) where 1 and 2 of them belong, so it stays too wide.
"""

import numpy as np

from peers.methods import protocols
from peers.methods.rule_table import Row, difference, errors, successes, figures
from peers.programs import crate, left_out, pose_from, probreg, pycpd
from peers.timing import timed
from reference import scans
from reference.pose_error import centroid_shift, frobenius, rotation_degrees

SAME = 2e-5
"""Degrees that f32 responsibilities may turn a pose by in as many steps."""
FOUND = 10.0
"""Degrees within which a pose counts as found."""
EXACT = 1e-6
"""Degrees below which a pose of two identical clouds of f32 points is exact: rounded
coordinates turn the best pose by 6e-8 / sqrt(500) of a radian, some 1e-7 degrees."""


def rows(scope):
    known = {"pycpd": pycpd_from, "probreg": probreg_from}
    peers = {name: peer for name, peer in known.items() if not left_out(name, name)}
    if not peers or scans.data_folder() is None:
        print("left out: CPD's peers (pycpd or probreg, and real scans, are needed)")
        return
    yield from same_steps(scope, peers)
    for kind in (protocols.accuracy, protocols.robustness):
        for large in (False, True):
            yield from protocol(scope, peers, kind, large)
    if not scope.smoke:
        yield from speed(peers)


def same_steps(scope, peers):
    """As many steps of each from the same clouds: the same pose."""
    for model in ("bunny",) if scope.smoke else ("bunny", "dragon"):
        (pair,) = protocols.accuracy(model, 1, False, points=500)
        for w in (0.0, 0.1):
            for steps in (10, 40):
                for name, peer in peers.items():
                    settings = {"outliers": w, "max_iterations": steps, "tolerance": 0.0}
                    found = crate.register(pair.source, pair.target, "cpd", scale="umeyama", **settings)
                    mine, theirs = found.transform, peer(pair, w, True, steps, 0.0)
                    label = f"{model} 500, w {w}, {steps} steps"
                    turned = rotation_degrees(rotation(mine), rotation(theirs))
                    yield difference("cpd", name, label, "rotation, deg", turned, SAME)
                    moved = centroid_shift(mine, theirs, pair.source)
                    yield difference("cpd", name, label, "shift, of the size", moved, 1e-7)
                    grown = abs(scale(mine) / scale(theirs) - 1)
                    yield difference("cpd", name, label, "scale, relative", grown, 5e-7)


def protocol(scope, peers, kind, large):
    """The defaults of each and w = 0.1: with scale beside peers with scale, without beside
    those without."""
    trials = 2 if scope.smoke else 12
    pairs = list(kind("bunny", trials, large))
    label = f"{kind.__name__} bunny {'large' if large else 'small'}"

    def mine(scale):
        found = [crate.register(pair.source, pair.target, "cpd", scale=scale) for pair in pairs]
        return pose_errors([answer.transform for answer in found], pairs)

    own_errors = {True: mine("umeyama"), False: mine("fixed")}
    variants = {f"{name}, scale": (peer, True) for name, peer in peers.items()}
    if "probreg" in peers:
        variants["probreg, fixed scale"] = (probreg_from, False)
    for name, (peer, scaled) in variants.items():
        both = own_errors[scaled], pose_errors([peer(pair, 0.1, scaled) for pair in pairs], pairs)
        found = [int(sum(error[:, 0] < FOUND)) for error in both]
        yield successes("cpd", name, label, *found, trials)
        yield median_angle(name, label, *(float(np.median(error[:, 0])) for error in both))
        frobenius = (float(np.median(error[:, 1])) for error in both)
        yield figures("cpd", name, label, "median |I - R R_gt^T|", *frobenius)


def median_angle(name, label, mine, theirs):
    if mine <= EXACT:
        found = f"{mine:.2e} | {theirs:.2e}"
        return Row("cpd", name, label, "median rotation, deg", found, f"exact: at most {EXACT:g}")
    return errors("cpd", name, label, "median rotation, deg", mine, theirs)


def speed(peers):
    (pair,) = protocols.accuracy("bunny", 1, False, points=5000)
    steps = 5
    mine, _ = timed(lambda: crate.register(pair.source, pair.target, "cpd", max_iterations=steps, tolerance=0.0))
    for name, peer in peers.items():
        theirs, _ = timed(lambda peer=peer: peer(pair, 0.1, True, steps, 0.0))
        yield figures("cpd", name, f"bunny 5000, {steps} wide steps", "seconds a step", mine / steps, theirs / steps)


def pose_errors(poses, pairs):
    """(trials, 2): degrees, and the paper's Frobenius norm."""
    return np.array(
        [
            [measure(rotation(pose), pair.truth) for measure in (rotation_degrees, frobenius)]
            for pose, pair in zip(poses, pairs)
        ]
    )


def pycpd_from(pair, w, _scale, iterations=None, tolerance=None):
    source, target, undo = in_radii(pair)
    return undo(*pycpd.register(source, target, w, iterations, tolerance))


def probreg_from(pair, w, scale, iterations=50, tolerance=0.001):
    source, target, undo = in_radii(pair)
    return undo(*probreg.coherent_point_drift(source, target, w, scale, iterations, tolerance))


def in_radii(pair):
    """Both clouds about the target's centroid in its root mean square radii, and what
    makes a (4, 4) pose of the pair from scale, rotation and translation between those."""
    center = pair.target.mean(axis=0)
    unit = np.sqrt(((pair.target - center) ** 2).sum(axis=1).mean())

    def undo(factor, turn, shift):
        matrix = factor * turn
        return pose_from(matrix, unit * shift + center - matrix @ center)

    return (pair.source - center) / unit, (pair.target - center) / unit, undo


def scale(pose):
    return float(np.cbrt(np.linalg.det(pose[:3, :3])))


def rotation(pose):
    """The pose without its scale."""
    result = pose.copy()
    result[:3, :3] /= scale(pose)
    return result
