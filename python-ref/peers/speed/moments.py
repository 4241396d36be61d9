"""The full connection: weights of all pairs and their sums, by whoever can."""

import cfreg
import numpy as np

from peers.programs import is_installed
from peers.speed import row
from peers.speed.samples import samples
from peers.timing import shortest
from reference.pose_error import rotation_degrees

BETA = 100.0


def rows(options):
    source, target = samples(options.points)
    own, other = (cfreg.fpfh(cloud) for cloud in (source, target))
    n, m = len(source), len(target)
    args = (source, target, own, other)

    def ours(tolerance):
        return lambda: cfreg.moments(*args, beta=BETA, tolerance=tolerance, threads=options.threads)

    peers = {"numpy, chunks of 128": by_numpy, "scipy cdist": by_scipy}
    if is_installed("pykeops"):
        peers["KeOps"] = by_keops
    if is_installed("torch"):
        peers["torch, chunks of 512"] = by_torch
    centred = [np.asarray(cloud - cloud.mean(axis=0), np.float32) for cloud in (source, target)]
    for peer, call in peers.items():
        times, answers = shortest(ours(0.0), ours(1e-3), lambda: call(*centred, own, other))
        dense, skipped, theirs = answers
        same = f"weight {abs(theirs / dense.weight - 1):.0e}"
        turned = rotation_degrees(cfreg.solve(dense), cfreg.solve(skipped))
        size = f"{n // 1000}k x {m // 1000}k"
        yield row(f"dense moments, {size}", times[0], times[2], peer, same)
        same = f"weight {abs(theirs / skipped.weight - 1):.0e}, turned {turned:.0e} deg"
        yield row(f"moments within 1e-3, {size}", times[1], times[2], peer, same)
    times, _ = shortest(ours(1e-3), ours(0.0))
    yield row(f"moments within 1e-3, {size}", *times, "ours, dense", "")


def by_numpy(source, target, own, other):
    return numpy_sums(source, target, own, other, BETA)[0]


def numpy_sums(source, target, own, other, beta, chunk=128):
    """Sums of w, w p, w q and w p q^T: matrix product, exponential in place, and the product
    with the targets. Chunks of 64 to 256 are the fastest."""
    mean = own.mean(axis=0)
    own, other = own - mean, other - mean
    lengths, others = (own**2).sum(axis=1), (other**2).sum(axis=1)
    homogeneous = np.column_stack([target, np.ones(len(target), np.float32)])
    weight, sums = 0.0, np.zeros((4, 4))
    for at in range(0, len(own), chunk):
        d2 = own[at : at + chunk] @ other.T
        d2 *= 2.0
        d2 -= lengths[at : at + chunk, None]
        d2 -= others
        d2 /= beta
        np.exp(d2, out=d2)
        rows = (d2 @ homogeneous).astype(np.float64)
        weight += rows[:, 3].sum()
        sums[:3] += source[at : at + chunk].T @ rows
        sums[3] += rows.sum(axis=0)
    return weight, sums[:3, 3], sums[3, :3], sums[:3, :3]


def by_scipy(source, target, own, other, chunk=512):
    from scipy.spatial.distance import cdist

    homogeneous = np.column_stack([target, np.ones(len(target), np.float32)])
    cross, weight = np.zeros((3, 4)), 0.0
    for at in range(0, len(own), chunk):
        sums = np.exp(-cdist(own[at : at + chunk], other, "sqeuclidean") / BETA) @ homogeneous
        weight += float(sums[:, 3].sum())
        cross += source[at : at + chunk].T @ sums
    return weight


def by_keops(source, target, own, other):
    from pykeops.numpy import LazyTensor

    homogeneous = np.column_stack([target, np.ones(len(target), np.float32)])
    d2 = ((LazyTensor(own[:, None, :]) - LazyTensor(other[None, :, :])) ** 2).sum(-1)
    sums = (-d2 / BETA).exp() @ homogeneous
    return float((source.T @ sums, sums[:, 3].sum(dtype=np.float64))[1])


def by_torch(source, target, own, other, chunk=512):
    import torch

    source, target, own, other = (torch.from_numpy(part) for part in (source, target, own, other))
    homogeneous = torch.cat([target, torch.ones(len(target), 1)], dim=1)
    cross, weight = torch.zeros(3, 4), 0.0
    for at in range(0, len(own), chunk):
        weights = torch.exp(torch.cdist(own[at : at + chunk], other).square_().div_(-BETA))
        sums = weights @ homogeneous
        weight += float(sums[:, 3].double().sum())
        cross += source[at : at + chunk].T @ sums
    return weight
