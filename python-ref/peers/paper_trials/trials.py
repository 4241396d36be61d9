"""Outcomes of the trials of a cell: CSV with the columns of the crate's own."""

import csv
import json
from dataclasses import asdict, dataclass, fields

import numpy as np

from reference.pose_error import frobenius, mean_shift, rotation_degrees

LOST = 0.5
"""Frobenius norm (20 degrees) above which a pose is not the one sought."""


@dataclass(frozen=True)
class Record:
    """One trial; the four errors are None without a pose."""

    trial: int
    rotation_deg: float | None = None
    frobenius: float | None = None
    """The paper's accuracy (section IV-D): norm of I - R R_gt^T."""
    translation: float | None = None
    """Error of the place of the source's centroid."""
    average_shift: float | None = None
    """The paper's (section IV-B): mean distance of the source's points to their places."""
    error: str = ""

    def lost(self):
        return self.frobenius is None or self.frobenius > LOST


def register(contender, cell):
    """A record a trial."""
    return [register_pair(contender, number, pair) for number, pair in enumerate(cell.pairs)]


def register_pair(contender, number, pair):
    try:
        pose = contender.align(pair, **contender.settings)
    except (RuntimeError, np.linalg.LinAlgError) as error:
        return Record(number, error=str(error) or type(error).__name__)
    if pose is None:
        return Record(number, error="no answer")
    return evaluated(number, np.asarray(pose), pair)


def evaluated(number, pose, pair):
    off = (pose - pair.truth)[:3, :3] @ pair.source.mean(axis=0) + (pose - pair.truth)[:3, 3]
    return Record(
        number,
        rotation_degrees(pose, pair.truth),
        frobenius(pose, pair.truth),
        float(np.linalg.norm(off)),
        mean_shift(pose, pair.truth, pair.source),
    )


def write(records, path, **configuration):
    """After a comment with all that the trials depend on."""
    with open(path, "w", newline="") as file:
        file.write(f"# {json.dumps(configuration)}\n")
        rows = csv.DictWriter(file, [field.name for field in fields(Record)], lineterminator="\n")
        rows.writeheader()
        rows.writerows(map(asdict, records))


def read(path):
    """Records of a file of ours or of the crate's, which has more columns."""
    number = lambda word: float(word) if word else None
    with open(path, newline="") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return [
            Record(
                int(row["trial"]),
                *(number(row[field.name]) for field in fields(Record)[1:5]),
                row["error"],
            )
            for row in rows
        ]
