"""Kernel Correlation beside probreg's GMMReg, the nearest that a package has.

GMMReg (Jian and Vemuri 2011) also makes the correlation of two blurred clouds greatest,
but of Gaussian mixtures fitted to them, by BFGS and at one bandwidth unless asked. The
figures are told, not judged: it is another method.
"""

import numpy as np

from peers import clouds, ours
from peers.cpd import in_radii, installed
from peers.table import told


def rows(scope):
    if not installed("probreg") or clouds.scans.data_folder() is None:
        print("left out: Kernel Correlation's neighbour (probreg, and real scans, are needed)")
        return
    trials, points = (1, 150) if scope.smoke else (5, 500)
    for kind in (clouds.accuracy, clouds.robustness):
        pairs = list(kind("bunny", trials, False, points=points))
        # Its mixtures start from a random state that cannot be handed in.
        np.random.seed(0)
        mine = [ours.register(pair.source, pair.target, "kc").transform for pair in pairs]
        errors = (
            float(np.median([ours.angle(pose, pair.truth) for pose, pair in zip(poses, pairs)]))
            for poses in (mine, map(gmmreg, pairs))
        )
        label = f"{kind.__name__} bunny small, {points}"
        yield told("kc", "probreg GMMReg", label, "median rotation, deg", *errors)


def gmmreg(pair):
    from probreg import l2dist_regs

    source, target, undo = in_radii(pair)
    found = l2dist_regs.registration_gmmreg(source, target)
    return undo(found.scale * found.rot, found.t)
