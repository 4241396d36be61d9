"""Do poses agree with each other by as much as their covariances say? No reference pose is asked.

    python loops.py FOLDER-OF-THE-SCANS          # with pairs.csv; the package `cfreg` is installed
    python loops.py FOLDER --most 10             # of each data set so many loops

Three scans of which all pairs are listed make a loop: a onto b onto c is a onto c. The difference, in
units of the three covariances together (NEES), is a sum of six squares, 5.3 in the median where
these are right. Beside it stands the same of each pose against its reference pose. A warp of a scan
that acts on all its poses alike is seen by the second alone, as is an error of the reference.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

SEED = 0
FAR = np.radians(15)
"""Turn from the reference above which a pose is another: its loop is left out."""
CHI_SQUARE_95 = 12.592


def cross(v):
    """(3, 3) matrix of the cross product with v."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def small(motion):
    """(6,) rotation vector and shift of a (4, 4) motion, which is about the zero of its frame."""
    return np.concatenate([Rotation.from_matrix(motion[:3, :3]).as_rotvec(), motion[:3, 3]])


def about_zero(covariance, center):
    """Covariance of turns about `center` as that of turns about the zero."""
    change = np.eye(6)
    change[3:, :3] = cross(center)
    return change @ covariance @ change.T


def carried(covariance, pose):
    """Covariance of small motions before `pose` as that of the same after it (its adjoint)."""
    change = np.zeros((6, 6))
    change[:3, :3] = change[3:, 3:] = pose[:3, :3]
    change[3:, :3] = cross(pose[:3, 3]) @ pose[:3, :3]
    return change @ covariance @ change.T


def nees(error, covariance):
    return float(error @ np.linalg.solve(covariance, error))


def loop_nees(onto_b, onto_c, across):
    """Of a onto b, b onto c and a onto c, each a (4, 4) pose with its covariance about the zero."""
    error = small(onto_c[0] @ onto_b[0] @ np.linalg.inv(across[0]))
    return nees(error, onto_c[1] + carried(onto_b[1], onto_c[0]) + across[1])


def loops(pairs, most):
    """At most so many (a, b, c) of which all pairs are in `pairs`, drawn with a fixed seed."""
    found = [(a, b, c) for a, b in pairs for d, c in pairs if d == b and (a, c) in pairs]
    return [found[i] for i in np.random.default_rng(SEED).permutation(len(found))[:most]]


class Registered:
    """Accepted poses of pairs, each found once."""

    def __init__(self, folder):
        import cfreg

        self.folder, self.cfreg, self.scans, self.poses = folder, cfreg, {}, {}

    def scan(self, name):
        if name not in self.scans:
            points = self.cfreg.read(self.folder / name).points
            self.scans[name] = self.cfreg.PointCloud(points, viewpoint=[0, 0, 0])
        return self.scans[name]

    def pose(self, pair):
        """Pose and its covariance about the zero; None where it was not accepted."""
        if pair not in self.poses:
            found = self.cfreg.register(*map(self.scan, pair))
            known = found.verdict.covariance if found.verdict.decision == "accept" else None
            whole = known is not None and len(known.undetermined) == 0
            self.poses[pair] = (
                (np.array(found.transform), about_zero(known.matrix, known.center)) if whole else None
            )
        return self.poses[pair]


def row(name, pairs, registered, most):
    """Of one data set, `pairs` by their reference poses."""
    closed, referred = [], {}
    for a, b, c in loops(pairs, most):
        sides = [(a, b), (b, c), (a, c)]
        poses = [registered.pose(side) for side in sides]
        if any(pose is None for pose in poses):
            continue
        errors = [small(pairs[side] @ np.linalg.inv(pose[0])) for side, pose in zip(sides, poses)]
        if any(np.linalg.norm(error[:3]) > FAR for error in errors):
            continue
        closed.append(loop_nees(*poses))
        for side, error, pose in zip(sides, errors, poses):
            referred[side] = nees(error, pose[1])
    if not closed:
        return f"| {name} | 0 | - | - | - |"
    within = np.mean(np.array(closed) < CHI_SQUARE_95)
    return (
        f"| {name} | {len(closed)} | {np.median(closed):.1f} | {within:.0%} "
        f"| {np.median(list(referred.values())):.1f} |"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--most", type=int, default=40, help="loops of each data set (40)")
    arguments = parser.parse_args()
    sets = {}
    with open(arguments.folder / "pairs.csv", newline="") as file:
        for line in csv.DictReader(file):
            pose = np.array([[float(line[f"t{i}{j}"]) for j in range(4)] for i in range(4)])
            sets.setdefault(line["dataset"], {})[line["source"], line["target"]] = pose
    registered = Registered(arguments.folder)
    print("| set | loops | NEES (median; 5.3 expected) | within the 95 % region | against the reference |")
    print("|---|---|---|---|---|")
    for name, pairs in sets.items():
        if loops(pairs, 1):
            print(row(name, pairs, registered, arguments.most), flush=True)


if __name__ == "__main__":
    main()
