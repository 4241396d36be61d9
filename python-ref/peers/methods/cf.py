"""CF beside the way the paper computed it, on the paper's protocols."""

import numpy as np

from peers.methods import paper_pipeline, protocols, rule_table
from peers.programs import crate, pcl
from reference.pose_error import frobenius, mean_shift
from reference.scans import data_folder

SUCCESS = {"accuracy": 0.5, "robustness": 0.025}
"""Error up to which a pose is counted as found: Frobenius norm (20 degrees), and mean shift
in the unit of the meshes (a tenth of their size)."""

QUANTITY = {"accuracy": "median |I - R Rt|_F", "robustness": "median mean shift"}


def rows(scope):
    if pcl.program("described_points") is None or data_folder() is None:
        return
    named = list(of_all_tests(1 if scope.smoke else 25))
    yield from compared("cf", named, by_crate("cf"), published)


def published(pair):
    return paper_pipeline.pose(pair.source, pair.target)


def of_all_tests(trials):
    """Name and pairs of each of the paper's tests on the bunny and the dragon: so many
    trials with a small rotation and as many with a large one."""
    for model in protocols.MESHES:
        for protocol in (protocols.accuracy, protocols.robustness):
            pairs = [pair for large in (False, True) for pair in protocol(model, trials, large)]
            yield f"{protocol.__name__} {model}", pairs


def by_crate(method, **settings):
    """The crate's answer to a pair and how many points of each cloud it connects."""
    import cfreg

    def answer(pair):
        try:
            found = crate.register(pair.source, pair.target, method, **settings)
        except cfreg.RegistrationError:
            return None, [0, 0]
        counts = [found.points[side]["described"] for side in ("source", "target")]
        return found.transform, counts

    return answer


def compared(method, named, mine, theirs, judged=True):
    """Rows of two answers to the pairs of each protocol: median errors, poses found and
    points connected, then the poses found over all protocols. One protocol has too few
    pairs to tell a success more or less from chance. Without judgement figures are only shown."""
    peer, total = "PCL + reference", np.zeros(2, dtype=int)
    for name, pairs in named:
        protocol = pairs[0].kind
        errors, counts = np.empty((2, len(pairs))), np.empty((2, len(pairs)))
        for trial, pair in enumerate(pairs):
            for who, answer in enumerate((mine, theirs)):
                found, points = answer(pair)
                errors[who, trial] = np.inf if found is None else error(protocol, found, pair)
                counts[who, trial] = np.mean(points)
        found = (errors <= SUCCESS[protocol]).sum(axis=1)
        total += found
        rule = rule_table.errors if judged else rule_table.figures
        yield rule(method, peer, name, QUANTITY[protocol], *np.median(errors, axis=1))
        yield rule_table.figures(method, peer, name, f"found of {len(pairs)}", *found)
        yield rule_table.figures(method, peer, name, "mean points connected", *counts.mean(axis=1))
    rule = rule_table.successes if judged else show_successes
    yield rule(method, peer, "all protocols", *total, sum(len(pairs) for _, pairs in named))


def show_successes(method, peer, clouds_of, ours_found, theirs_found, trials):
    return rule_table.figures(method, peer, clouds_of, f"found of {trials}", ours_found, theirs_found)


def error(protocol, found, pair):
    """The paper's error: of the rotation for accuracy (section IV-D), the mean distance of
    the points to where they belong for robustness (section IV-B)."""
    if protocol == "accuracy":
        return frobenius(found, pair.truth)
    return mean_shift(found, pair.truth, pair.source)
