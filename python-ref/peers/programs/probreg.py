"""probreg: Coherent Point Drift, and GMMReg."""


def coherent_point_drift(source, target, outliers, estimate_scale, iterations=50, tolerance=0.001):
    """Scale, rotation (3, 3) and translation (3,)."""
    from probreg import cpd

    found = cpd.registration_cpd(
        source, target, "rigid", outliers, iterations, tolerance, update_scale=estimate_scale
    ).transformation
    return found.scale, found.rot, found.t


def gmmreg(source, target):
    """The same, of two Gaussian mixtures (Jian and Vemuri 2011)."""
    from probreg import l2dist_regs

    found = l2dist_regs.registration_gmmreg(source, target)
    return found.scale, found.rot, found.t
