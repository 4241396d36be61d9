"""Fits the verdict model of `consensus` on tables of `cfreg benchmark --candidates`, and prints the
coefficients, and their value on sources that were left out of the fit, as tables in Markdown.

    python -m verdict.fit_verdict CANDIDATES.csv...
    python -m verdict.fit_verdict --write MODEL.json --version NAME CANDIDATES.csv...
                                                     # a model for `cfreg --verdict-model MODEL.json`

Two regressions with a ridge penalty, and with signs that are fixed in advance: more overlap never
makes a pose less probable. The first ranks the poses of a pair by their evidence: a conditional
logistic regression of which refined poses of a pair are right, on the pairs that have right and wrong
ones. The second gives the probability of the answer, by its evidence and by how it was found: a
logistic regression on the answers, each with weight 1.

The tables of results leave out one source after the other: a source is a sensor with a scene. All
scans of the kitchen are one source. The pairs that show the source are left out of both fits, and the
fitted model judges the answers of these pairs. An answer with a free motion, and one that the crate
called ambiguous, is not accepted.

Pairs of data sets named `made` (`verdict.made_pairs`) are fitted like any other; each kind of them is a
source. Results of real scans and of made pairs are told apart.
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
from scipy.stats import beta

from peers.printed import table
from peers.programs import REPOSITORY

MODEL = REPOSITORY / "src/verify/model.json"
EVIDENCE = {
    "overlap": +1,
    "surface_conflict": -1,
    "residual_std": -1,
    "surface_patches": +1,
    "descriptor_distinctiveness": +1,
    "inlier_score": +1,
    "free_space_violation": -1,
}
"""Terms of the evidence, in the order of the model file, with the sign of their coefficients."""
FOUND = {"supporting_hypotheses": +1, "translation_std": -1, "margin": +1}
"""Terms of an answer beside its evidence, likewise."""
POSE_RIDGE, ANSWER_RIDGE = 3.0, 1.0
"""Ridge penalties of standardised coefficients, beside weights that sum to the number of pairs and of
answers. Chosen by hand among 0.1, 1, 3: sources left out are ranked alike."""
KITCHEN = {"7-scenes-redkitchen", "rgbd_7scenes_frames", "rgbd_tsdf_fusion"}
NO_SENSOR = {"stanford_bunny", "stanford_dragon_stand", "stanford_happy_stand", "stanford_armadillo_simulated"}
"""Sources whose sensor was not at the zero of the files, whatever the benchmark was told: their rows do
not fit the coefficient of free space."""


def source_of(file):
    """The source that a scan belongs to: the name of its folder, but one for all of the kitchen."""
    folder = Path(file).parent.name
    return "kitchen" if folder in KITCHEN else folder


def pose_terms(row):
    """Values of the terms of the evidence, as `VerdictModel` documents them."""
    number = lambda name: float(row[name] or 0.0)
    known = row["free_space_violation"] != "" and Path(row["source"]).parent.name not in NO_SENSOR
    return [
        np.log(number("overlap") + 0.01),
        number("surface_conflict"),
        np.log(number("residual_std") + 0.05),
        np.log1p(number("surface_patches")),
        np.log(max(number("descriptor_distinctiveness") + 0.1, 0.01)),
        np.log1p(number("inlier_score")),
        np.sqrt(number("free_space_violation")) if known else 0.0,
    ]


def answer_terms(row):
    """Values of the terms `FOUND`."""
    if row["answer"] != "true":
        return [0.0] * len(FOUND)
    number = lambda name: float(row[name])
    return [np.log1p(number("supporting_hypotheses")), np.log(number("translation_std")), number("margin")]


@dataclass
class Poses:
    """Rows of a table, by column."""

    terms: np.ndarray
    """(N, 7), those of `EVIDENCE`."""
    found: np.ndarray
    """(N, 3), those of `FOUND`; 0 for poses that are no answer."""
    right: np.ndarray
    ambiguous: np.ndarray
    """Whether surfaces leave a motion free, or the crate called the answer ambiguous."""
    pairs: np.ndarray
    """Number of the pair that a pose belongs to."""
    sets: np.ndarray
    sources: np.ndarray
    """(N, 2), those of source and target."""

    @classmethod
    def from_rows(cls, rows):
        return cls(
            np.array([pose_terms(row) for row in rows]).reshape(-1, len(EVIDENCE)),
            np.array([answer_terms(row) for row in rows]).reshape(-1, len(FOUND)),
            np.array([row["right"] == "true" for row in rows], bool),
            np.array([row["unconstrained"] not in ("", "0") or row["decision"] == "ambiguous" for row in rows], bool),
            np.array([row["pair"] for row in rows], int),
            np.array([row["dataset"] for row in rows]),
            np.array([[source_of(row["source"]), source_of(row["target"])] for row in rows]).reshape(-1, 2),
        )

    def where(self, which):
        return Poses(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def shows(self, sources):
        """Whether the source or the target of a row is one of `sources`."""
        return np.isin(self.sources, list(sources)).any(axis=1)

    @property
    def unrelated(self):
        """Whether the clouds of a pair show different scenes."""
        return np.char.startswith(self.sets, "unrelated")

    @property
    def made(self):
        """Whether the clouds of a pair are simulated."""
        return np.char.find(self.sets, "made ") >= 0


def standardised(terms):
    """Terms of mean 0 and standard deviation 1, with mean and deviation; constant terms are 0."""
    mean, deviation = terms.mean(axis=0), terms.std(axis=0)
    constant = deviation < 1e-9
    deviation = np.where(constant, 1.0, deviation)
    return np.where(constant, 0.0, (terms - mean) / deviation), mean, deviation


def minimised(loss, signs, intercept):
    """The minimum of a loss (with its gradient) over coefficients of the given signs."""
    bounds = [(None, None)] * intercept + [(0, None) if sign > 0 else (None, 0) for sign in signs]
    return minimize(loss, np.zeros(len(bounds)), jac=True, method="L-BFGS-B", bounds=bounds).x


def logistic(terms, right, signs, ridge):
    """Intercept and coefficients of the greatest penalised likelihood; each coefficient has its sign,
    or is 0."""
    sign = np.where(right, 1.0, -1.0)
    scaled, mean, deviation = standardised(terms)
    columns = np.column_stack([np.ones(len(terms)), scaled])
    penalty = np.r_[0.0, np.full(terms.shape[1], ridge)]

    def loss(coefficients):
        odds = sign * (columns @ coefficients)
        slope = -sign / (1 + np.exp(np.clip(odds, -500, 500)))
        value = np.sum(np.logaddexp(0, -odds)) + penalty @ coefficients**2
        return value, columns.T @ slope + 2 * penalty * coefficients

    found = minimised(loss, signs, True)
    coefficients = found[1:] / deviation
    return np.r_[found[0] - coefficients @ mean, coefficients]


def conditional_logistic(terms, right, pairs, weights, signs, ridge):
    """Coefficients that rank the poses of a pair: the likelihood is that of the right poses among all
    poses of their pair. `weights` are those of pairs, by their number."""
    order = np.argsort(pairs, kind="stable")
    terms, right, pairs = terms[order], right[order], pairs[order]
    numbers, starts, counts = np.unique(pairs, return_index=True, return_counts=True)
    hits = np.add.reduceat(right.astype(int), starts)
    useful = (hits > 0) & (hits < counts)
    rows = np.repeat(useful, counts)
    scaled, _, deviation = standardised(terms[rows])
    right, starts = right[rows].astype(float), np.cumsum(np.r_[0, counts[useful]])[:-1]
    group = np.repeat(np.arange(len(starts)), counts[useful])
    weights = np.array([weights[number] for number in numbers[useful]])
    weights = weights / np.mean(weights)

    def loss(coefficients):
        score = scaled @ coefficients
        share = np.exp(score - np.maximum.reduceat(score, starts)[group])
        whole, part = np.add.reduceat(share, starts), np.add.reduceat(share * right, starts)
        slope = (share / whole[group] - share * right / part[group]) * weights[group]
        value = weights @ (np.log(whole) - np.log(part)) + ridge * coefficients @ coefficients
        return value, scaled.T @ slope + 2 * ridge * coefficients

    return minimised(loss, signs, False) / deviation


def pair_weights(poses):
    """Weights of pairs by their number: sets of many pairs count more, by the root of their number."""
    sets = dict(zip(poses.pairs, poses.sets))
    count = Counter(sets.values())
    return {pair: count[name] ** -0.5 for pair, name in sets.items()}


@dataclass
class Model:
    """Coefficients of the `EVIDENCE` that rank poses; intercept and coefficients of the `EVIDENCE` and
    of what was `FOUND`, for the probability of an answer."""

    pose: np.ndarray
    answer: np.ndarray

    def probabilities(self, answers):
        odds = self.answer[0] + np.column_stack([answers.terms, answers.found]) @ self.answer[1:]
        return 1 / (1 + np.exp(-np.clip(odds, -30, 30)))


def fit(poses, answers):
    """The model of the greatest penalised likelihood."""
    signs = list(EVIDENCE.values())
    pose = conditional_logistic(poses.terms, poses.right, poses.pairs, pair_weights(poses), signs, POSE_RIDGE)
    terms = np.column_stack([answers.terms, answers.found])
    return Model(pose, logistic(terms, answers.right, [*signs, *FOUND.values()], ANSWER_RIDGE))


def calibration_error(probability, right, bins=10):
    """Mean difference of probability and share of right answers, in bins of equal width."""
    bin_ = np.minimum((bins * probability).astype(int), bins - 1)
    off = [abs(np.sum(probability[bin_ == k]) - np.sum(right[bin_ == k])) for k in range(bins)]
    return sum(off) / max(len(right), 1)


def interval(hits, count, level=0.95):
    """Clopper-Pearson interval of a share, as text: `3/40 (2-20 %)`."""
    if count == 0:
        return "-"
    low = beta.ppf((1 - level) / 2, hits, count - hits + 1) if hits else 0.0
    high = beta.ppf((1 + level) / 2, hits + 1, count - hits) if hits < count else 1.0
    return f"{hits}/{count} ({100 * low:.1f}-{100 * high:.1f} %)"


def thresholds():
    """Those of the crate."""
    return json.loads(MODEL.read_text())["thresholds"]


RESULTS = ["calibration error", "unrelated, accepted", "wrong, accepted", "right, not accepted", "right, rejected"]


def results(probability, answers):
    """Values of the columns `RESULTS`."""
    accepted = (probability >= thresholds()["accept"]) & ~answers.ambiguous
    rejected = probability < thresholds()["reject"]
    wrong = ~answers.right & ~answers.unrelated
    count = lambda hit, among: interval(int(np.sum(hit & among)), int(np.sum(among)))
    return [
        f"{calibration_error(probability, answers.right):.3f}",
        count(accepted, answers.unrelated),
        count(accepted, wrong),
        count(~accepted, answers.right),
        count(rejected, answers.right),
    ]


def crate_model():
    """The model of the crate."""
    model = json.loads(MODEL.read_text())
    part = lambda name, terms: np.array([model[name][term] for term in terms])
    return Model(part("pose", EVIDENCE), part("answer", ["intercept", *EVIDENCE, *FOUND]))


def model_file(model, version, data):
    """The model as a model file has it; the thresholds are those of the crate."""
    rounded = lambda names, values: {name: round(float(value), 4) for name, value in zip(names, values)}
    answer = rounded(["intercept", *EVIDENCE, *FOUND], model.answer)
    return {
        "version": version,
        "fitted": {
            "date": datetime.date.today().isoformat(),
            "command": "python-ref/verdict/verdict.sh",
            "data": data,
        },
        "pose": {"intercept": 0.0, "sensors_known": 0.0, **rounded(EVIDENCE, model.pose)},
        "answer": {"intercept": answer.pop("intercept"), "sensors_known": 0.0, **answer},
        "thresholds": thresholds(),
    }


def read(paths):
    """The candidates of all tables, and the answers of each table by its name."""
    candidates, answers, numbers = [], {}, {}
    for path in paths:
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        for row in rows:
            row["pair"] = numbers.setdefault((path, row["source"], row["target"]), len(numbers))
        candidates += [row for row in rows if row["answer"] != "true"]
        answers[Path(path).stem] = Poses.from_rows([row for row in rows if row["answer"] == "true"])
    return Poses.from_rows(candidates), answers


def concatenated(parts):
    """Poses of several tables as of one."""
    parts = list(parts)
    return Poses(*(np.concatenate([getattr(part, name) for part in parts]) for name in Poses.__dataclass_fields__))


def print_table(titles, rows):
    print("\n".join(table(titles, rows)))


def print_coefficients(model, poses, answers):
    crate = crate_model()
    print(f"Coefficients, fitted on {len(poses.right)} poses and {len(answers.right)} answers:\n")
    rows = [
        [f"{part}.{name}", f"{value:.3f}", f"{old:.3f}"]
        for part, names, fitted, now in [
            ("pose", EVIDENCE, model.pose, crate.pose),
            ("answer", ["intercept", *EVIDENCE, *FOUND], model.answer, crate.answer),
        ]
        for name, value, old in zip(names, fitted, now)
    ]
    print_table(["coefficient", "fitted", "crate"], rows)
    print("\nIn sample: all of these answers were fitted.\n")
    told = lambda by, which: results(by.probabilities(answers.where(which)), answers.where(which))
    kinds = [("real scans", ~answers.made), ("made pairs", answers.made)]
    rows = [
        [f"{name}, {kind}", *told(by, which)]
        for kind, which in kinds
        for name, by in [("fitted", model), ("crate", crate)]
        if which.any()
    ]
    print_table(["model", *RESULTS], rows)


def left_out(poses, answers):
    """The probability of each answer by the model that is fitted without its sources."""
    told = np.zeros(len(answers.right))
    kinds = sorted({tuple(sorted(pair)) for pair in answers.sources})
    for pair in kinds:
        judged = (np.sort(answers.sources, axis=1) == pair).all(axis=1)
        model = fit(poses.where(~poses.shows(pair)), answers.where(~answers.shows(pair)))
        told[judged] = model.probabilities(answers.where(judged))
    return told


def print_left_out(told, answers):
    print("\nLeave one source out: the model that judges a pair has seen no pair that shows its scenes.\n")
    rows = []
    add = lambda name, which: rows.append([name, int(np.sum(which)), *results(told[which], answers.where(which))])
    real = ~answers.made
    for name in sorted(set(answers.sources[real & ~answers.unrelated, 0])):
        add(name, real & ~answers.unrelated & (answers.sources[:, 0] == name))
    add("unrelated pairs", real & answers.unrelated)
    add("all real scans", real)
    for name in sorted(set(answers.sources[~real, 0])):
        add(f"made: {name}", ~real & (answers.sources[:, 0] == name))
    if not real.all():
        add("all made pairs", ~real)
    print_table(["left out", "answers", *RESULTS], rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("candidates", nargs="+")
    parser.add_argument("--write", metavar="MODEL.json", help="write the fitted coefficients as a model file")
    parser.add_argument("--version", default="unnamed", help="name of the model that is written")
    asked = parser.parse_args()
    poses, tables = read(asked.candidates)
    answers = concatenated(tables.values())
    model = fit(poses, answers)
    print_coefficients(model, poses, answers)
    print_left_out(left_out(poses, answers), answers)
    if asked.write:
        data = f"{len(answers.right)} answers of {', '.join(tables)}"
        Path(asked.write).write_text(json.dumps(model_file(model, asked.version, data), indent=2) + "\n")


if __name__ == "__main__":
    main()
