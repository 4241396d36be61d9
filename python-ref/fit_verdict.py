"""Fits the verdict of `consensus` on what `cfreg benchmark --candidates` wrote, and prints the
constants beside those of the source (`Evidence::log_odds`).

    python fit_verdict.py CANDIDATES.csv...

A logistic regression on all settled poses, each data set's right and wrong ones with the same
weight in all; then slope and offset of its log odds on the answers alone, each with weight 1.
Files with the sensors' places (`contradicted` is there) and without make a fit each.
"""

import csv
import sys

import numpy as np
from scipy.optimize import minimize

NAMES = ["1", "ln(overlap + 0.01)", "ln(max(likeness + 0.1, 0.01))", "ln(1 + support)", "sqrt(contradicted)"]
SOURCE = {True: [8.0, 2.08, 3.97, 0.48, -27.7], False: [-5.95, -1.41, 4.29, 2.33]}
"""Constants of `Evidence::log_odds`, by whether the sensors' places are known."""


def features(row):
    """The terms of the log odds; the last only where the sensors' places are known."""
    terms = [
        1.0,
        np.log(float(row["overlap"]) + 0.01),
        np.log(max(float(row["likeness"]) + 0.1, 0.01)),
        np.log1p(float(row["support"])),
    ]
    return terms + [np.sqrt(float(row["contradicted"]))] if row["contradicted"] else terms


def logistic(terms, right, weights):
    """Constants of the greatest weighted likelihood, held from infinity by a weak prior."""
    sign = np.where(right, 1.0, -1.0)

    def loss(constants):
        odds = sign * (terms @ constants)
        slope = -weights * sign / (1 + np.exp(np.clip(odds, -500, 500)))
        prior = 1e-4 * np.mean(weights)
        value = weights @ np.logaddexp(0, -odds) + prior * constants @ constants
        return value, terms.T @ slope + 2 * prior * constants

    return minimize(loss, np.zeros(terms.shape[1]), jac=True, method="BFGS").x


def balanced(sets, right):
    """The same sum of weights for every set's right and for its wrong poses."""
    groups = list(zip(sets, right))
    count = {group: groups.count(group) for group in set(groups)}
    return np.array([len(groups) / len(count) / count[group] for group in groups])


def fit(rows):
    """Calibrated constants, and the calibration's slope and offset."""
    terms = np.array([features(row) for row in rows])
    right = np.array([row["right"] == "true" for row in rows])
    answer = np.array([row["answer"] == "true" for row in rows])
    raw = logistic(terms, right, balanced([row["dataset"] for row in rows], right))
    odds = np.column_stack([np.ones(answer.sum()), terms[answer] @ raw])
    offset, slope = logistic(odds, right[answer], np.ones(len(odds)))
    constants = slope * raw
    constants[0] += offset
    return constants, slope, offset


def main(paths):
    rows = []
    for path in paths:
        with open(path, newline="") as file:
            rows.extend(csv.DictReader(file))
    for known in (True, False):
        of = [row for row in rows if (row["contradicted"] != "") == known]
        if not of:
            continue
        constants, slope, offset = fit(of)
        answers = sum(row["answer"] == "true" for row in of)
        print(f"\nsensors' places {'known' if known else 'unknown'}: {len(of)} poses, {answers} answers,")
        print(f"slope {slope:.2f}, offset {offset:.2f}\n\n| term | fitted | source |\n|---|---|---|")
        for name, fitted, source in zip(NAMES, constants, SOURCE[known]):
            print(f"| {name} | {fitted:.2f} | {source} |")


if __name__ == "__main__":
    main(sys.argv[1:] or sys.exit(__doc__))
