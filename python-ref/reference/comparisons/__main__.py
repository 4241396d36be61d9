"""The crate's Python module beside the reference, exact arithmetic and Open3D.

    python -m reference.comparisons                   everything
    python -m reference.comparisons --without-cfreg   the reference, exact arithmetic and Open3D only
    python -m reference.comparisons --only methods    one story

Prints one table of differences and exits with 1 and the names of those above their bound.
Clouds are real scans where there are any (CFREG_DATA, else ../shared/data beside the
repository), procedural reliefs elsewhere.
"""

import argparse
import importlib
import sys

from reference.comparisons import Scope, difference_table

STORIES = (
    "exact_moments",
    "exact_poses",
    "exact_surfaces",
    "pipeline",
    "methods",
    "open3d_registration",
)
"""Modules of `reference.comparisons`, from the numbers up to registrations."""


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--without-cfreg", action="store_true", help="leave the crate out")
    arguments.add_argument("--points", type=int, default=sys.maxsize, help="at most so many a cloud")
    arguments.add_argument("--only", choices=STORIES, help="this story alone")
    options = arguments.parse_args()
    scope = Scope(None if options.without_cfreg else load_cfreg(), options.points)
    print(difference_table.HEADER)
    exceeded = []
    for name in [options.only] if options.only else STORIES:
        story = importlib.import_module(f"reference.comparisons.{name}")
        for title, rows in story.sections(scope):
            exceeded += difference_table.print_section(title, rows, story.BOUNDS)
    print()
    for line in exceeded:
        print("exceeded:", line)
    if not exceeded:
        print("every difference is within its bound")
    return 1 if exceeded else 0


def load_cfreg():
    try:
        return importlib.import_module("cfreg")
    except ImportError as error:
        sys.exit(f"{error}: build the crate's module first, or use --without-cfreg")


if __name__ == "__main__":
    sys.exit(main())
