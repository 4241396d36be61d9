"""Do poses agree with each other by as much as their covariances say? No reference pose is asked.

    python -m peers.loops FOLDER-OF-THE-SCANS    # with pairs.csv; the package `cfreg` is installed
    python -m peers.loops FOLDER --most 10             # of each data set so many loops

Three scans of which all pairs are listed make a loop: a onto b onto c is a onto c. The difference, in
units of the three covariances together (NEES), is a sum of six squares, 5.3 in the median where
these are right. Beside it stands the same of each pose against its reference pose. A warp of a scan
that acts on all its poses alike is seen by the second alone, as is an error of the reference.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from peers.printed import rule_line, table_line
from peers.programs import crate
from reference.rotations import cross_matrix
from reference.scans import read_pairs

SEED = 0
WRONG_POSE = np.radians(15)
"""Turn from the reference above which a pose is another: its loop is left out."""
CHI_SQUARE_95 = 12.592
TITLES = (
    "set",
    "loops",
    "NEES (median; 5.3 expected)",
    "within the 95 % region",
    "against the reference",
)


def twist_from(motion):
    """(6,) rotation vector and shift of a (4, 4) motion, which is about the zero of its frame."""
    return np.concatenate([Rotation.from_matrix(motion[:3, :3]).as_rotvec(), motion[:3, 3]])


def about_zero(covariance, center):
    """Covariance of turns about `center` as that of turns about the zero."""
    change = np.eye(6)
    change[3:, :3] = cross_matrix(center)
    return change @ covariance @ change.T


def after_pose(covariance, pose):
    """Covariance of small motions before `pose` as that of the same after it (its adjoint)."""
    change = np.zeros((6, 6))
    change[:3, :3] = change[3:, 3:] = pose[:3, :3]
    change[3:, :3] = cross_matrix(pose[:3, 3]) @ pose[:3, :3]
    return change @ covariance @ change.T


def nees(error, covariance):
    return float(error @ np.linalg.solve(covariance, error))


def loop_nees(onto_b, onto_c, across):
    """NEES of the poses a onto b, b onto c and a onto c, each (4, 4) with its covariance about the zero."""
    error = twist_from(onto_c[0] @ onto_b[0] @ np.linalg.inv(across[0]))
    return nees(error, onto_c[1] + after_pose(onto_b[1], onto_c[0]) + across[1])


def loops(pairs, most):
    """At most so many (a, b, c) of which all pairs are in `pairs`, drawn with a fixed seed."""
    found = [(a, b, c) for a, b in pairs for d, c in pairs if d == b and (a, c) in pairs]
    return [found[i] for i in np.random.default_rng(SEED).permutation(len(found))[:most]]


class PoseCache:
    """Accepted poses of pairs, each found once."""

    def __init__(self, folder):
        self.folder, self.scans, self.poses = folder, {}, {}

    def scan(self, name):
        if name not in self.scans:
            self.scans[name] = crate.read_seen_from_zero(self.folder / name)
        return self.scans[name]

    def pose(self, pair):
        """Pose and its covariance about the zero; None where it was not accepted."""
        if pair not in self.poses:
            found = crate.register(*map(self.scan, pair), "consensus")
            known = found.verdict.covariance if found.verdict.decision == "accept" else None
            whole = known is not None and len(known.undetermined) == 0
            self.poses[pair] = (
                (np.array(found.transform), about_zero(known.matrix, known.center)) if whole else None
            )
        return self.poses[pair]


def row(name, pairs, cache, most):
    """The line of one data set, whose `pairs` have their reference poses."""
    closed, referred = [], {}
    for a, b, c in loops(pairs, most):
        sides = [(a, b), (b, c), (a, c)]
        poses = [cache.pose(side) for side in sides]
        if any(pose is None for pose in poses):
            continue
        errors = [twist_from(pairs[side] @ np.linalg.inv(pose[0])) for side, pose in zip(sides, poses)]
        if any(np.linalg.norm(error[:3]) > WRONG_POSE for error in errors):
            continue
        closed.append(loop_nees(*poses))
        for side, error, pose in zip(sides, errors, poses):
            referred[side] = nees(error, pose[1])
    if not closed:
        return table_line([name, 0, "-", "-", "-"])
    within = np.mean(np.array(closed) < CHI_SQUARE_95)
    own, beside = (f"{np.median(values):.1f}" for values in (closed, list(referred.values())))
    return table_line([name, len(closed), own, f"{within:.0%}", beside])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--most", type=int, default=40, help="loops of each data set (40)")
    arguments = parser.parse_args()
    sets = {}
    for pair in read_pairs(arguments.folder / "pairs.csv"):
        sets.setdefault(pair["dataset"], {})[pair["source"], pair["target"]] = pair["truth"]
    cache = PoseCache(arguments.folder)
    print(table_line(TITLES))
    print(rule_line(len(TITLES)))
    for name, pairs in sets.items():
        if loops(pairs, 1):
            print(row(name, pairs, cache, arguments.most), flush=True)


if __name__ == "__main__":
    main()
