"""Write small solved cases to tests/golden, for the crate's tests to read.

    python -m reference.golden            write every case
    python -m reference.golden --check    compute every case and compare with what is there

The schema is described in tests/golden/README.md. Seeds are fixed. The cases are made by
the modules of `reference.golden`.
"""

import argparse
import importlib
import json
import pkgutil
import re
import sys

import numpy as np

import reference.golden
from peers.programs import REPOSITORY

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
    for module in pkgutil.iter_modules(reference.golden.__path__):
        if only in (None, module.name) and module.name != "__main__":
            yield from importlib.import_module(f"reference.golden.{module.name}").cases().items()


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


def agrees(a, b, size=0.0, clear=1e-9):
    """Whether two contents are the same but for the last digits of another BLAS.

    size : the greatest number of the record that they are in: what cancels to zero is rounding
        of numbers of that size
    clear : to what share an answer is determined at all, as solvers of the reference tell
    """
    if isinstance(a, dict):
        size, clear = greatest(a), max(clear, a.get("solvers_differ_by", 0.0))
        rest = [key for key in a if key != "solvers_differ_by"]
        return a.keys() == b.keys() and all(agrees(a[key], b[key], size, clear) for key in rest)
    if isinstance(a, list):
        if a and all(isinstance(entry, (int, float)) for entry in a):
            atol = clear * np.abs(a).max() + 1e-12 * size
            return len(a) == len(b) and np.allclose(a, b, rtol=clear, atol=atol)
        return len(a) == len(b) and all(agrees(x, y, size, clear) for x, y in zip(a, b))
    if isinstance(a, float):
        return bool(np.isclose(a, b, rtol=clear, atol=1e-12))
    return a == b


def greatest(content):
    """The greatest absolute value of all numbers in it."""
    if isinstance(content, dict):
        content = content.values()
    elif not isinstance(content, list):
        return abs(content) if isinstance(content, (int, float)) else 0.0
    return max(map(greatest, content), default=0.0)


if __name__ == "__main__":
    sys.exit(main())
