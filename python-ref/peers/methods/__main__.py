"""Print the crate's methods beside their peers, as one table.

    python -m peers.methods                     all methods
    python -m peers.methods --only icp,cpd      these alone
    python -m peers.methods --smoke             few trials and small clouds

Peers that are not installed are left out, in a line that says so. Exits with 1 when a
rule of the table does not hold.
"""

import argparse
import importlib
import pkgutil
import sys
from dataclasses import dataclass
from pathlib import Path

import peers.methods
from peers.methods.rule_table import HEADER
from peers.printed import Transcript


@dataclass(frozen=True)
class Scope:
    smoke: bool
    """Whether a minute is all there is."""


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--only", metavar="METHOD,..", help="these methods alone")
    arguments.add_argument("--smoke", action="store_true", help="few trials, small clouds")
    arguments.add_argument("--output", type=Path, help="write the table to this file too")
    options = arguments.parse_args()
    only = options.only.split(",") if options.only else sorted(methods())
    if unknown := set(only) - set(methods()):
        arguments.error(f"no such method: {', '.join(unknown)}; there are {', '.join(methods())}")
    transcript, broken = Transcript(), 0
    transcript.say(HEADER)
    for name in only:
        module = importlib.import_module(f"peers.methods.{name}")
        for row in module.rows(Scope(options.smoke)):
            transcript.say(row.line())
            broken += not row.holds
    transcript.write(options.output)
    print(f"\n{broken} rules do not hold" if broken else "\nevery rule holds")
    return 1 if broken else 0


def methods():
    """Modules that compare."""
    apart = {"__main__", "paper_pipeline", "protocols", "rule_table"}
    return [m.name for m in pkgutil.iter_modules(peers.methods.__path__) if m.name not in apart]


if __name__ == "__main__":
    sys.exit(main())
