"""Moments, poses and whole registrations of the crate beside the reference's."""

import numpy as np

import reference as ref
from reference.pose_error import rotation_degrees
from reference.surfaces import as_f32

DISTANCE_ROUNDING = 2e-2
"""Error of |a|² + |b|² - 2 a.b in f32 for FPFH, at the very worst: five roundings of
|a|² + |b|² <= 6e4, each 6e-8 of it."""

KERNELS = [name for name in ref.KERNELS if name != "gaussian"]
NORMALISATIONS = ("none", "source", "target", "both", "sinkhorn:10")

BOUNDS = {
    "sum of weights, relative": (5e-5, "d² of 33 bins in f32 is off by 1e-3, beta is 100"),
    "sum of squared weights, relative": (1e-4, "twice that of the weights"),
    "moments, relative to size": (2e-5, "weights as above, sums in f64"),
    "truncated: change of a sum per pair in doubt": (1.0, "such a pair weighs 0 or 1"),
    "pose from equal moments, difference": (1e-12, "closed forms in f64 on both sides"),
    "pose, rotation, degrees": (1e-4, "moments as above: 2e-5 at the very worst, in part a factor"),
    "pose, translation / size": (2e-6, "moments as above, in part a common factor"),
    "register, rotation, degrees": (0.02, "pairs in other bins: equal normals, ties, edges"),
    "register, translation / size": (2e-4, "pairs in other bins: equal normals, ties, edges"),
}


def sums(a, b, size, cfreg, beta):
    """Moments of the crate beside the reference's about the crate's origins, from the
    same descriptors, for the Gaussian under every normalisation and every kernel
    without; then the poses that follow. The truncated kernel jumps, so that its sums
    may change by the pairs whose side f32 does not decide, and no more."""
    schemes = [("gaussian", name) for name in NORMALISATIONS] + [(name, "none") for name in KERNELS]
    features = [as_f32(s.fpfh["pcl"]) for s in (a, b)]
    d2 = ref.squared_distances(*features)
    for kernel, normalisation in schemes:
        found = cfreg.moments(
            a.points,
            b.points,
            *(f.astype(np.float32) for f in features),
            weights=kernel,
            beta=beta,
            normalize=normalisation,
        )
        weights = ref.normalise(ref.weigh(d2, kernel, beta), normalisation)
        origins = np.asarray(found.source_origin), np.asarray(found.target_origin)
        expected = ref.moments(weights, a.points, b.points, *origins)
        apart = moments_difference(found, expected, size)
        label = f"cfreg - reference, {kernel}, {normalisation}"
        if kernel == "truncated":
            in_doubt = np.count_nonzero(np.abs(d2 - beta) < DISTANCE_ROUNDING)
            change = max(abs(found.weight - expected.weight), apart * expected.weight)
            yield "truncated: pairs in doubt, share of the weight", label, in_doubt / expected.weight
            yield "truncated: change of a sum per pair in doubt", label, change / max(in_doubt, 1)
            continue
        yield "sum of weights, relative", label, relative(found.weight, expected.weight)
        squared = relative(found.weight_squared, expected.weight_squared)
        yield "sum of squared weights, relative", label, squared
        yield "moments, relative to size", label, apart
        if kernel == "gaussian":
            yield from poses(found, expected, size, cfreg, label)


def poses(found, expected, size, cfreg, label):
    same = ref.Moments(**{name: np.asarray(getattr(found, name)) for name in vars(expected)})
    for solver in ref.SOLVERS:
        for scale in ("fixed", "umeyama", "symmetric"):
            matrix = np.asarray(cfreg.solve(found, solver=solver, scale=scale))
            who = f"{label}, {solver}, scale {scale}"
            alone = ref.solve(same, solver, scale).matrix()
            yield "pose from equal moments, difference", who, pose_difference(matrix, alone, size)[2]
            angle, shift, _ = pose_difference(matrix, ref.solve(expected, solver, scale).matrix(), size)
            yield "pose, rotation, degrees", who, angle
            yield "pose, translation / size", who, shift


def registration(a, b, size, cfreg, beta):
    """From clouds to pose at once, both seen from the origin."""
    result = cfreg.register(a, b, "cf", neighbors=ref.NEIGHBORS, beta=beta)
    expected = ref.register(a, b, ref.NEIGHBORS, beta).matrix()
    angle, shift, _ = pose_difference(result.transform, expected, size)
    yield "register, rotation, degrees", "cfreg - reference", angle
    yield "register, translation / size", "cfreg - reference", shift


def moments_difference(a, b, size):
    """The largest difference of any moment, each relative to the sum of weights and
    as many factors `size` as it has lengths."""
    return max(
        np.abs(np.asarray(getattr(a, name)) - getattr(b, name)).max() / (b.weight * size**power)
        for name, power in (
            ("source_sum", 1),
            ("target_sum", 1),
            ("cross", 2),
            ("source_squares", 2),
            ("target_squares", 2),
        )
    )


def pose_difference(a, b, size):
    """Between two (4, 4) similarities: angle in degrees, translation over `size`, and
    the largest difference of an entry with lengths over `size`."""
    turned = rotation_degrees(*(m[:3, :3] / np.cbrt(np.linalg.det(m[:3, :3])) for m in (a, b)))
    shift = np.linalg.norm(a[:3, 3] - b[:3, 3]) / size
    return turned, shift, max(np.abs(a - b)[:3, :3].max(), shift)


def relative(a, b):
    return abs(a - b) / abs(b)
