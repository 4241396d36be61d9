"""The stages of the paper's method on pairs of clouds: features, sums, poses."""

import reference as ref
from reference import scans
from reference.comparisons import features, sums
from reference.surfaces import as_f32

BOUNDS = features.BOUNDS | sums.BOUNDS

SCANS = ((scans.BUNNY, 5000), (scans.DRAGON, 2000), (scans.ROOM, 3000))
RELIEFS = (3000, 500)


def sections(scope):
    for pair in pairs(scope.points):
        yield f"{pair.name}, k = {ref.NEIGHBORS}, beta = {ref.BETA:g}", measured(pair, scope.cfreg)


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
    source = features.scene(pair.source, pair.source_viewpoint, ref.NEIGHBORS)
    target = features.scene(pair.target, pair.target_viewpoint, ref.NEIGHBORS)
    for s in (source, target):
        yield from features.ties(s)
        yield from features.normals(s, cfreg)
        yield from features.descriptors(s, cfreg)
    if cfreg:
        yield from sums.sums(source, target, pair.size(), cfreg, ref.BETA)
        # Only rotated about the viewpoint, the default one of both sides.
        turned = as_f32(pair.target - pair.translation)
        yield from sums.registration(pair.source, turned, pair.size(), cfreg, ref.BETA)
