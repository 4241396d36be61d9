"""Fits the verdict of `consensus` on the table of `cfreg benchmark --candidates`, and prints the
coefficients beside those of the crate (`src/verify/model.json`), as tables in Markdown.

    python -m verdict.fit_verdict CANDIDATES.csv...             # the coefficients
    python -m verdict.fit_verdict --held-out CANDIDATES.csv...  # and what they are worth elsewhere
    python -m verdict.fit_verdict --write MODEL.json --version NAME CANDIDATES.csv...
                                                     # a model for `cfreg --verdict-model MODEL.json`

Two logistic regressions on settled poses, with the sensors' places known (`contradicted` is there)
and without, each data set's right and wrong ones with the same weight in all; streets do not take
part, nor, in the first, scans whose sensor was not at the zero of the file. They rank the poses of a
pair. Then one more for both, on the answers alone, each with weight 1: their log odds, how many settled
poses are the answer, how well it is held. A pose that several tables have counts once; an answer is
one of its table.

Held out: place by place, all pairs that show it are left out, the others are fitted, and the
answers to those left out are judged. All scans of a kitchen are one place, whichever set they come from.
Answers stay those that the crate's model chose, and another answer that is about as good
(`ambiguous`) is not looked at: accepted is a probability of 0.7 or more.
"""

import argparse
import csv
import datetime
import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from peers.printed import table
from peers.programs import REPOSITORY

TERMS = ["1", "ln(overlap + 0.01)", "ln(max(likeness + 0.1, 0.01))", "ln(1 + support)", "sqrt(contradicted)"]
STANDING = ["1", "log odds", "ln(1 + votes)", "ln(spread)"]
MODEL = REPOSITORY / "src/verify/model.json"
POSE = ["intercept", "overlap", "descriptor_distinctiveness", "inlier_score", "free_space_violation"]
"""Names of the `TERMS` in the model file."""
ANSWER = ["intercept", "pose", "supporting_hypotheses", "translation_std"]
"""Names of `STANDING` there."""
KITCHEN = {"7-scenes-redkitchen", "rgbd_7scenes_frames", "rgbd_tsdf_fusion"}
ELSEWHERE = {"stanford_bunny", "stanford_dragon_stand", "stanford_armadillo_simulated"}
"""Where the zero of the files is not where the sensor stood, whatever the benchmark was told."""
STREETS = {"kitti00", "tls_3dtk", "lidar_small_gicp"}
"""Where many settled poses that count as wrong have the evidence of right ones."""
NONE = np.zeros(len(TERMS))
ACCEPT = 0.7


@dataclass
class Poses:
    """Rows of a table, by column."""

    terms: np.ndarray
    """0 for the last where it is not known."""
    standing: np.ndarray
    """Terms that stand beside the log odds, `STANDING[2:]`; 0 for poses that are no answer."""
    known: np.ndarray
    """Whether the sensors' places are."""
    right: np.ndarray
    sets: np.ndarray
    places: np.ndarray
    """(N, 2), those of source and target."""

    @classmethod
    def from_rows(cls, rows):
        return cls(
            np.array([terms(row) for row in rows]),
            np.array([standing(row) for row in rows]),
            np.array([row["contradicted"] != "" for row in rows]),
            np.array([row["right"] == "true" for row in rows]),
            np.array([row["dataset"] for row in rows]),
            np.array([[place(row["source"]), place(row["target"])] for row in rows]),
        )

    def where(self, which):
        return Poses(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def shows(self, where):
        """Whether source or target shows the place."""
        return (self.places == where).any(axis=1)

    @property
    def unrelated(self):
        return self.places[:, 0] != self.places[:, 1]

    def fitting_set(self, known):
        """Those that the constants of the kind are fitted on."""
        among = lambda places: np.isin(self.places, list(places)).any(axis=1)
        return self.where((self.known == known) & ~among(STREETS) & ~(known & among(ELSEWHERE)))

    def odds(self, constants):
        """The logarithms, by the constants for either kind."""
        known, unknown = (self.terms @ constants[kind] for kind in (True, False))
        return np.where(self.known, known, unknown)


def place(file):
    """The place that a scan shows: the name of its folder, but one for all of the kitchen's."""
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


def standing(row):
    """The terms that an answer has beside its evidence."""
    if row["answer"] != "true":
        return [0.0, 0.0]
    return [np.log1p(float(row["votes"])), np.log(float(row["spread"]))]


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


@dataclass
class Judge:
    """The constants that tell the probability of an answer."""

    evidence: dict
    """Constants of the `TERMS`, by whether the sensors' places are known."""
    answer: np.ndarray
    """Constants of `STANDING`."""

    def probabilities(self, answers):
        """The probabilities of being right."""
        odds = with_standing(answers, self.evidence) @ self.answer
        return 1 / (1 + np.exp(-np.clip(odds, -30, 30)))


def with_standing(answers, evidence):
    """(N, 4) values of `STANDING`."""
    return np.column_stack([np.ones(len(answers.right)), answers.odds(evidence), answers.standing])


def fit(poses, answers):
    """A judge whose constants are all fitted."""
    raw = {}
    for kind in (True, False):
        among = poses.fitting_set(kind)
        weights = balanced(among.sets, among.right)
        raw[kind] = logistic(among.terms, among.right, weights) if len(among.right) else NONE
    return fit_standing(raw, answers)


def fit_standing(evidence, answers):
    """A judge by these constants of the evidence, the others fitted."""
    weights = np.ones(len(answers.right))
    return Judge(evidence, logistic(with_standing(answers, evidence), answers.right, weights))


def calibration_error(probability, right):
    """How far what is told is from what is right, in tenths of the probability, mean over poses."""
    tenth = np.minimum((10 * probability).astype(int), 9)
    off = [abs(np.sum(probability[tenth == k]) - np.sum(right[tenth == k])) for k in range(10)]
    return sum(off) / len(right)


def cells(probability, answers):
    """Calibration error; accepted ones of unrelated pairs, of other wrong poses; right ones refused."""
    accepted = probability >= ACCEPT
    wrong = ~answers.right & ~answers.unrelated

    def share(hit, among):
        return f"{np.sum(hit & among)}/{np.sum(among)}" if among.any() else "-"

    return [
        f"{calibration_error(probability, answers.right):.3f}",
        share(accepted, answers.unrelated),
        share(accepted, wrong),
        share(~accepted, answers.right),
    ]


def source_judge():
    """The judge of the crate."""
    model = json.loads(MODEL.read_text())
    pose = {
        True: np.array([model["pose"]["sensors_known"][name] for name in POSE]),
        False: np.array([model["pose"]["sensors_unknown"][name] for name in POSE]),
    }
    return Judge(pose, np.array([model["answer"][name] for name in ANSWER]))


def model_of(judge, version, data):
    """The judge as a model file has it; the thresholds are those of the crate."""
    rounded = lambda names, values: {name: round(float(value), 4) for name, value in zip(names, values)}
    return {
        "version": version,
        "fitted": {
            "date": datetime.date.today().isoformat(),
            "command": "python-ref/verdict/verdict.sh",
            "data": data,
        },
        "pose": {
            "sensors_known": rounded(POSE, judge.evidence[True]),
            "sensors_unknown": rounded(POSE, judge.evidence[False]),
        },
        "answer": rounded(ANSWER, judge.answer),
        "thresholds": json.loads(MODEL.read_text())["thresholds"],
    }


def read(paths):
    """The candidates of all tables, each once, and the answers of each table by its name."""
    candidates, answers = {}, {}
    for path in paths:
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        candidates.update((tuple(row.values()), row) for row in rows if row["answer"] != "true")
        answers[Path(path).stem] = Poses.from_rows([row for row in rows if row["answer"] == "true"])
    return Poses.from_rows(list(candidates.values())), answers


def concatenated(parts):
    """Poses of several tables as of one."""
    return Poses(*(np.concatenate([getattr(part, name) for part in parts]) for name in Poses.__dataclass_fields__))


def print_table(titles, rows):
    print("\n".join(table(titles, rows)))


JUDGED = ["calibration error", "unrelated, accepted", "other wrong, accepted", "right, refused"]


def fitted(poses, answers, source):
    """Prints the fit on all poses beside the constants of the source."""
    every = concatenated(answers.values())
    judge = fit(poses, every)
    anew = fit_standing(source.evidence, every)
    titles, columns = ["term"], [TERMS]
    for kind, name in [(True, "known"), (False, "unknown")]:
        titles += [f"{name}: fitted on {len(poses.fitting_set(kind).right)} poses", "crate"]
        columns += [[f"{value:.2f}" for value in by.evidence[kind]] for by in (judge, source)]
    print_table(titles, zip(*columns))
    print(f"\n{len(every.right)} answers:\n")
    columns = [[f"{value:.2f}" for value in by.answer] for by in (judge, anew, source)]
    print_table(["term", "fitted", "by the source's evidence", "crate"], zip(STANDING, *columns))
    print("\nAll answers, which all of these have seen:\n")
    rows = [
        [run, len(judged.right), name, *cells(by.probabilities(judged), judged)]
        for run, judged in answers.items()
        for name, by in [("fitted", judge), ("source's evidence, fitted", anew), ("crate", source)]
    ]
    print_table(["table", "answers", "constants", *JUDGED], rows)


def held_out(poses, answers, source):
    """Prints what the fit is worth at places that it has not seen."""
    everything = concatenated(answers.values())
    judged = {run: [] for run in answers}
    for where in sorted(set(everything.places.flat)):
        others = everything.where(~everything.shows(where))
        judge = fit(poses.where(~poses.shows(where)), others)
        anew = fit_standing(source.evidence, others)
        for run, every in answers.items():
            left = every.where(every.shows(where))
            if len(left.right):
                judged[run].append((where, left, [by.probabilities(left) for by in (judge, anew, source)]))
    for run, places in judged.items():
        every = concatenated([left for _, left, _ in places])
        places.append(("all of these", every, [np.concatenate(told) for told in zip(*(by for *_, by in places))]))
        print(f"\n`{run}`, place by place left out: all fitted on the others / the source's evidence, the rest fitted on")
        print("the others / the source, which has seen it. Pairs of two places are in both rows.\n")
        rows = []
        for where, left, told_by in places:
            beside = zip(*(cells(by, left) for by in told_by))
            rows.append([where, len(left.right), *("-" if set(cell) == {"-"} else " / ".join(cell) for cell in beside)])
        print_table(["left out", "answers", *JUDGED], rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("candidates", nargs="+")
    parser.add_argument("--held-out", action="store_true", help="leave out one place after the other")
    parser.add_argument("--write", metavar="MODEL.json", help="write the fitted coefficients as a model file")
    parser.add_argument("--version", default="unnamed", help="name of the model that is written")
    asked = parser.parse_args()
    poses, answers = read(asked.candidates)
    if asked.write:
        every = concatenated(answers.values())
        data = f"{len(every.right)} answers of {', '.join(answers)}"
        text = json.dumps(model_of(fit(poses, every), asked.version, data), indent=2)
        Path(asked.write).write_text(text + "\n")
    fitted(poses, answers, source_judge())
    if asked.held_out:
        held_out(poses, answers, source_judge())


if __name__ == "__main__":
    main()
