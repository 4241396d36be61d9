"""Write small solved cases to tests/golden, for the crate's tests to read.

    python golden.py            write every case
    python golden.py --check    compute every case and compare with what is there

The schema is described in tests/golden/README.md. Seeds are fixed. The cases are made by
the modules of `golden_cases`.
"""

import argparse
import importlib
import json
import pkgutil
import re
import sys

import numpy as np

import golden_cases
from scans import REPOSITORY

FOLDER = REPOSITORY / "tests" / "golden"


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--check", action="store_true", help="compare, write nothing")
    arguments.add_argument("--only", metavar="MODULE", help="cases of this module alone")
    options = arguments.parse_args()
    failures = 0
    for name, (given, expected) in cases(options.only):
        for part, content in (("input", given), ("expected", expected)):
            path = FOLDER / name / f"{part}.json"
            if options.check:
                same = agrees(json.loads(path.read_text()), plain(content))
                print(f"{path.relative_to(REPOSITORY)}: {'same' if same else 'DIFFERENT'}")
                failures += not same
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text(content))
                print(f"{path.relative_to(REPOSITORY)}: {path.stat().st_size} bytes")
    return 1 if failures else 0


def cases(only):
    """Name and (input, expected) of every case, by module and in its order."""
    for module in pkgutil.iter_modules(golden_cases.__path__):
        if only in (None, module.name):
            yield from importlib.import_module(f"golden_cases.{module.name}").cases().items()


def plain(value):
    """Arrays as lists and numpy's numbers as Python's."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def text(content):
    """JSON whose rows of numbers are one line each; numbers read back bit for bit."""
    spread = json.dumps(plain(content), indent=1, allow_nan=False)
    rows = re.compile(r"\[\s*((?:[-+.\deE]+,?\s*)+)\]")
    return rows.sub(lambda row: "[" + ", ".join(re.split(r",\s*", row[1].strip())) + "]", spread) + "\n"


def agrees(a, b):
    """Whether two contents are the same but for the last digits of another BLAS."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(
            agrees(a[key], b[key]) for key in a if key != "solvers_differ_by"
        )
    if isinstance(a, list):
        if a and all(isinstance(entry, (int, float)) for entry in a):
            return len(a) == len(b) and np.allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(a).max())
        return len(a) == len(b) and all(map(agrees, a, b))
    if isinstance(a, float):
        return bool(np.isclose(a, b, rtol=1e-9, atol=1e-12))
    return a == b


if __name__ == "__main__":
    sys.exit(main())
