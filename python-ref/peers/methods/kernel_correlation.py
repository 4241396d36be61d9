"""Kernel Correlation beside probreg's GMMReg, the nearest that a package has.

GMMReg (Jian and Vemuri 2011) also makes the correlation of two blurred clouds greatest,
but of Gaussian mixtures fitted to them, by BFGS and at one bandwidth unless asked. The
figures are shown, not judged: it is another method.
"""

import numpy as np

from peers.methods import protocols
from peers.methods.cpd import in_radii
from peers.methods.rule_table import figures
from peers.programs import crate, left_out, probreg
from reference import scans
from reference.pose_error import rotation_degrees


def rows(scope):
    if left_out("probreg", "probreg") or scans.data_folder() is None:
        print("left out: Kernel Correlation's neighbour (probreg, and real scans, are needed)")
        return
    trials, points = (1, 150) if scope.smoke else (5, 500)
    for kind in (protocols.accuracy, protocols.robustness):
        pairs = list(kind("bunny", trials, False, points=points))
        # Its mixtures start from a random state that cannot be handed in.
        np.random.seed(0)
        mine = [crate.register(pair.source, pair.target, "kc").transform for pair in pairs]
        errors = (
            float(np.median([rotation_degrees(pose, pair.truth) for pose, pair in zip(poses, pairs)]))
            for poses in (mine, map(gmmreg, pairs))
        )
        label = f"{kind.__name__} bunny small, {points}"
        yield figures("kc", "probreg GMMReg", label, "median rotation, deg", *errors)


def gmmreg(pair):
    source, target, undo = in_radii(pair)
    return undo(*probreg.gmmreg(source, target))
