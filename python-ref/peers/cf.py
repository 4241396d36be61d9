"""CF beside the way the paper computed it, on the paper's protocols."""

import numpy as np

from peers import clouds, ours, pcl_features, table
from scans import data_folder

SUCCESS = {"accuracy": 0.5, "robustness": 0.025}
"""Error up to which a pose is counted as found: Frobenius norm (20 degrees), and mean shift
in the unit of the meshes (a tenth of their size)."""

QUANTITY = {"accuracy": "median |I - R Rt|_F", "robustness": "median mean shift"}


def rows(scope):
    if pcl_features.program("described_points") is None or data_folder() is None:
        return
    for clouds_of, pairs in protocols(1 if scope.smoke else 25):
        yield from compared("cf", clouds_of, pairs, ours_by("cf"), published)


def published(pair):
    return pcl_features.pose(pair.source, pair.target)


def protocols(trials):
    """Name and pairs of each of the paper's tests on the bunny and the dragon: so many
    trials with a small rotation and as many with a large one."""
    for model in clouds.MESHES:
        for protocol in (clouds.accuracy, clouds.robustness):
            pairs = [pair for large in (False, True) for pair in protocol(model, trials, large)]
            yield f"{protocol.__name__} {model}", pairs


def ours_by(method, **settings):
    """The crate's answer to a pair and how many points of each cloud it connects."""
    import cfreg

    def answer(pair):
        try:
            found = ours.register(pair.source, pair.target, method, **settings)
        except cfreg.RegistrationError:
            return None, [0, 0]
        counts = [found["points"][side]["described"] for side in ("source", "target")]
        return found["transform"], counts

    return answer


def compared(method, name, pairs, mine, theirs, judged=True):
    """Rows of successes, median errors and points connected of two answers to each pair;
    with too few pairs for a rule only told."""
    protocol = pairs[0].kind
    errors, counts = np.empty((2, len(pairs))), np.empty((2, len(pairs)))
    for trial, pair in enumerate(pairs):
        for who, answer in enumerate((mine, theirs)):
            found, points = answer(pair)
            errors[who, trial] = np.inf if found is None else error(protocol, found, pair)
            counts[who, trial] = np.mean(points)
    found = (errors <= SUCCESS[protocol]).sum(axis=1)
    medians = np.median(errors, axis=1)
    peer = "PCL + reference"
    if judged:
        yield table.successes(method, peer, name, *found, len(pairs))
        yield table.errors(method, peer, name, QUANTITY[protocol], *medians)
    else:
        yield table.told(method, peer, name, f"found of {len(pairs)}", *found)
        yield table.told(method, peer, name, QUANTITY[protocol], *medians)
    yield table.told(method, peer, name, "mean points connected", *counts.mean(axis=1))


def error(protocol, found, pair):
    """The paper's error: of the rotation for accuracy (section IV-D), the mean distance of
    the points to where they belong for robustness (section IV-B)."""
    if protocol == "accuracy":
        return ours.frobenius(found, pair.truth)
    apart = pair.source @ (found - pair.truth)[:3, :3].T + (found - pair.truth)[:3, 3]
    return float(np.linalg.norm(apart, axis=1).mean())
