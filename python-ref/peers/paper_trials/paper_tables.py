"""Tables I and II with the peers, as Markdown."""

import numpy as np

from peers.paper_trials.trials import LOST
from peers.printed import table

TESTS = {
    "robustness": ("Table I: average shift (m)", "average_shift"),
    "accuracy": ("Table II: norm of I - R R_gt^T", "frobenius"),
}

LEGEND = f"""# The paper's tables with methods that it does not have

Each cell: mean ± deviation over the trials with an answer, then (median; how many are lost,
of all: without a pose, or off by more than {LOST} in the norm of Table II, 20 degrees).
Rows that name no package are this crate's, from the trials of `cfreg-paper reproduce`. The part of
the mesh that a sensor at 180 degrees sees stands in for ArmadilloStand_180.
"""


def markdown(results, contenders):
    """`results` has records by cell name and row; `contenders` say their settings."""
    text = [LEGEND]
    for test, (title, measure) in TESTS.items():
        cells = sorted((name for name in results if name.startswith(test)), key=place)
        rows = dict.fromkeys(row for name in cells for row in results[name])
        if not cells:
            continue
        heads = ", ".join({name.split("_")[1] for name in cells})
        trials = max(len(records) for name in cells for records in results[name].values())
        few = ": a check that all runs, not a measurement" if trials < 30 else ""
        text += [f"## {title}, reading: {heads}", "", f"{trials} trials a cell{few}.", ""]
        titles = (", ".join(name.split("_")[2:]) for name in cells)
        body = ([row, *(summary(results[name].get(row), measure) for name in cells)] for row in rows)
        text += [*table(["", *titles], body), ""]
    text += ["## Settings", "", "Lengths in units of the clouds' spacing.", ""]
    for contender in contenders:
        settings = ", ".join(f"{name} {value}" for name, value in contender.settings.items())
        text += [f"- {contender.title()}: {settings}"]
    return "\n".join(text) + "\n"


def place(name):
    """Columns in the order of the paper: small rotations first, bunny, dragon, Armadillo."""
    _, _, shape, motion = name.split("_")
    return motion != "small", {"bunny": 0, "dragon": 1}.get(shape, 2)


def summary(records, measure):
    if not records:
        return ""
    values = [getattr(r, measure) for r in records if getattr(r, measure) is not None]
    lost = sum(record.lost() for record in records)
    if not values:
        return f"none ({lost} lost)"
    mean, deviation, median = (number(statistic(values)) for statistic in (np.mean, np.std, np.median))
    return f"{mean} ± {deviation} ({median}; {lost})"


def number(value):
    """Two significant digits."""
    if value == 0.0:
        return "0"
    magnitude = np.floor(np.log10(abs(value)))
    return f"{value:.1e}" if magnitude < -4 else f"{value:.{int(max(1 - magnitude, 0))}f}"
