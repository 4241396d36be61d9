"""Fits the verdict of `consensus` on what `cfreg benchmark --candidates` wrote, and prints the
constants beside those of the source (`Evidence::log_odds`), as tables in Markdown.

    python fit_verdict.py CANDIDATES.csv...             # the constants
    python fit_verdict.py --held-out CANDIDATES.csv...  # and what they are worth elsewhere

Two logistic regressions on settled poses, with the sensors' places known (`contradicted` is there)
and without, each data set's right and wrong ones with the same weight in all; streets do not take
part, nor, in the first, scans whose sensor was not at the zero of the file. Then one slope and one
offset for both, so that their order stays, on the answers alone, each with weight 1. A pose that
several tables have counts once; an answer is one of its table.

Held out: place by place, all pairs that show it are left out, the others are fitted, and the
answers to those left out are judged. All scans of a kitchen are one place, whichever set they come from.
Answers stay those that the source's constants chose, and another answer that is about as good
(`ambiguous`) is not looked at: accepted is a probability of 0.5 or more.
"""

import argparse
import csv
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

TERMS = ["1", "ln(overlap + 0.01)", "ln(max(likeness + 0.1, 0.01))", "ln(1 + support)", "sqrt(contradicted)"]
SOURCE = Path(__file__).resolve().parent.parent / "src/method/consensus/evidence.rs"
KITCHEN = {"7-scenes-redkitchen", "rgbd_7scenes_frames", "rgbd_tsdf_fusion"}
ELSEWHERE = {"stanford_bunny", "stanford_dragon_stand", "stanford_armadillo_simulated"}
"""Where the zero of the files is not where the sensor stood, whatever the benchmark was told."""
STREETS = {"kitti00", "tls_3dtk", "lidar_small_gicp"}
"""Where many settled poses that count as wrong have the evidence of right ones."""
NONE = np.zeros(len(TERMS))
ACCEPT = 0.5


@dataclass
class Poses:
    """Rows of a table, by column."""

    terms: np.ndarray
    """0 for the last where it is not known."""
    known: np.ndarray
    """Whether the sensors' places are."""
    right: np.ndarray
    sets: np.ndarray
    places: np.ndarray
    """Of source and target."""

    @classmethod
    def of(cls, rows):
        return cls(
            np.array([terms(row) for row in rows]),
            np.array([row["contradicted"] != "" for row in rows]),
            np.array([row["right"] == "true" for row in rows]),
            np.array([row["dataset"] for row in rows]),
            np.array([[place(row["source"]), place(row["target"])] for row in rows]),
        )

    def where(self, which):
        return Poses(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def show(self, where):
        """Whether source or target shows the place."""
        return (self.places == where).any(axis=1)

    @property
    def unrelated(self):
        return self.places[:, 0] != self.places[:, 1]

    def of_kind(self, known):
        """Those that the constants of the kind are fitted on."""
        among = lambda places: np.isin(self.places, list(places)).any(axis=1)
        return self.where((self.known == known) & ~among(STREETS) & ~(known & among(ELSEWHERE)))

    def odds(self, constants):
        """The logarithms, by the constants for either kind."""
        known, unknown = (self.terms @ constants[kind] for kind in (True, False))
        return np.where(self.known, known, unknown)


def place(file):
    """What a scan shows: the name of its folder, but of the kitchen's."""
    folder = Path(file).parent.name
    return "kitchen" if folder in KITCHEN else folder


def terms(row):
    """The terms of the log odds."""
    return [
        1.0,
        np.log(float(row["overlap"]) + 0.01),
        np.log(max(float(row["likeness"]) + 0.1, 0.01)),
        np.log1p(float(row["support"])),
        np.sqrt(float(row["contradicted"] or 0.0)),
    ]


def logistic(terms, right, weights):
    """Constants of the greatest weighted likelihood, held from infinity by a weak prior."""
    sign = np.where(right, 1.0, -1.0)
    weights = weights / np.mean(weights)

    def loss(constants):
        odds = sign * (terms @ constants)
        slope = -weights * sign / (1 + np.exp(np.clip(odds, -500, 500)))
        value = weights @ np.logaddexp(0, -odds) + 1e-4 * constants @ constants
        return value, terms.T @ slope + 2e-4 * constants

    return minimize(loss, np.zeros(terms.shape[1]), jac=True, method="BFGS").x


def balanced(sets, right):
    """The same sum of weights for every set's right and for its wrong poses."""
    groups = list(zip(sets, right))
    count = Counter(groups)
    return np.array([1 / count[group] for group in groups])


def fit(poses, answers):
    """Calibrated constants for either kind, and the calibration's slope and offset."""
    raw = {}
    for kind in (True, False):
        of = poses.of_kind(kind)
        raw[kind] = logistic(of.terms, of.right, balanced(of.sets, of.right)) if len(of.right) else NONE
    return calibrated(raw, answers)


def calibrated(constants, answers):
    """The constants after one slope and offset of their log odds, and those two."""
    odds = np.column_stack([np.ones(len(answers.right)), answers.odds(constants)])
    offset, slope = logistic(odds, answers.right, np.ones(len(odds)))
    first = np.eye(len(TERMS))[0]
    return {kind: slope * of + offset * first for kind, of in constants.items()}, slope, offset


def told(constants, poses):
    """The probabilities of being right."""
    return 1 / (1 + np.exp(-np.clip(poses.odds(constants), -30, 30)))


def calibration_error(probability, right):
    """How far what is told is from what is right, in tenths of the probability, mean over poses."""
    tenth = np.minimum((10 * probability).astype(int), 9)
    off = [abs(np.sum(probability[tenth == k]) - np.sum(right[tenth == k])) for k in range(10)]
    return sum(off) / len(right)


def cells(probability, answers):
    """Calibration error; accepted ones of unrelated pairs, of other wrong poses; right ones refused."""
    accepted = probability >= ACCEPT
    wrong = ~answers.right & ~answers.unrelated

    def share(hit, of):
        return f"{np.sum(hit & of)}/{np.sum(of)}" if of.any() else "-"

    return [
        f"{calibration_error(probability, answers.right):.3f}",
        share(accepted, answers.unrelated),
        share(accepted, wrong),
        share(~accepted, answers.right),
    ]


def of_source():
    """Constants of `Evidence::log_odds`, by whether the sensors' places are known."""
    text = SOURCE.read_text()
    arms = re.search(r"Some\(share\) => (.*?)None => (.*?),\n", text, re.S).groups()
    found = [[float(n.replace(" ", "")) for n in re.findall(r"[-+]? ?\d+\.\d+", arm)] for arm in arms]
    return {True: np.array(found[0]), False: np.array(found[1] + [0.0])}


def read(paths):
    """The candidates of all tables, each once, and the answers of each table by its name."""
    candidates, answers = {}, {}
    for path in paths:
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        candidates.update((tuple(row.values()), row) for row in rows if row["answer"] != "true")
        answers[Path(path).stem] = Poses.of([row for row in rows if row["answer"] == "true"])
    return Poses.of(list(candidates.values())), answers


def joined(parts):
    """Poses of several tables as of one."""
    return Poses(*(np.concatenate([getattr(part, name) for part in parts]) for name in Poses.__dataclass_fields__))


def table(titles, rows):
    for row in [titles, ["---"] * len(titles), *rows]:
        print("| " + " | ".join(map(str, row)) + " |")


JUDGED = ["calibration error", "unrelated, accepted", "other wrong, accepted", "right, refused"]


def fitted(poses, answers, source):
    """Prints the fit on all poses beside the constants of the source."""
    every = joined(answers.values())
    constants, slope, offset = fit(poses, every)
    anew, slope_anew, offset_anew = calibrated(source, every)
    print(f"Slope {slope:.2f}, offset {offset:.2f}; of the source's constants {slope_anew:.2f}, {offset_anew:.2f}.\n")
    titles, columns = ["term"], [TERMS]
    for kind, name in [(True, "known"), (False, "unknown")]:
        titles += [f"{name}: fitted on {len(poses.of_kind(kind).right)} poses", "source"]
        columns += [[f"{value:.2f}" for value in of[kind]] for of in (constants, source)]
    table(titles, zip(*columns))
    print("\nAll answers, which all of these have seen:\n")
    rows = [
        [run, len(of.right), name, *cells(told(by, of), of)]
        for run, of in answers.items()
        for name, by in [("fitted", constants), ("source, calibrated anew", anew), ("source", source)]
    ]
    table(["table", "answers", "constants", *JUDGED], rows)


def held_out(poses, answers, source):
    """Prints what the fit is worth at places that it has not seen."""
    everything = joined(answers.values())
    judged = {run: [] for run in answers}
    for where in sorted(set(everything.places.flat)):
        others = everything.where(~everything.show(where))
        constants, *fitted = fit(poses.where(~poses.show(where)), others)
        anew, *again = calibrated(source, others)
        for run, of in answers.items():
            left = of.where(of.show(where))
            if not len(left.right):
                continue
            told_by = [told(by, left) for by in (constants, anew, source)]
            judged[run].append((where, line(fitted), line(again), left, told_by))
    for run, places in judged.items():
        every = joined([left for *_, left, _ in places])
        places.append(("all of these", "", "", every, [np.concatenate(of) for of in zip(*(by for *_, by in places))]))
        print(f"\n`{run}`, place by place left out: fitted on the others / the source's constants calibrated on the")
        print("others / the source's constants, which have seen it. Pairs of two places are in both rows.\n")
        rows = []
        for where, fitted, again, left, told_by in places:
            beside = zip(*(cells(by, left) for by in told_by))
            beside = ["-" if set(of) == {"-"} else " / ".join(of) for of in beside]
            rows.append([where, len(left.right), fitted, again, *beside])
        table(["left out", "answers", "slope, offset", "of the source", *JUDGED], rows)


def line(calibration):
    slope, offset = calibration
    return f"{slope:.2f}, {offset:.2f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("candidates", nargs="+")
    parser.add_argument("--held-out", action="store_true", help="leave out one place after the other")
    asked = parser.parse_args()
    poses, answers = read(asked.candidates)
    fitted(poses, answers, of_source())
    if asked.held_out:
        held_out(poses, answers, of_source())


if __name__ == "__main__":
    main()
