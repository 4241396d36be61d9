"""Measures the package and its peers in turn, and prints one table.

    python -m peers.speed                      all, one thread
    python -m peers.speed --threads 2 --only poses
"""

import argparse
import importlib
import os
import sys
from datetime import date
from pathlib import Path

from peers import processors
from peers.printed import Transcript

STORIES = ("moments", "features", "poses")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--threads", type=int, default=1, help="of both sides [1]")
    arguments.add_argument("--points", type=int, default=30_000, help="of a cloud [30000]")
    arguments.add_argument("--only", default=",".join(STORIES), help=f"some of {','.join(STORIES)}")
    arguments.add_argument("--output", type=Path, help="write the table there, too")
    options = arguments.parse_args()
    # Libraries read these when they are loaded.
    os.environ.update(dict.fromkeys(THREADS, str(options.threads)))
    processors.limit(options.threads)
    transcript = Transcript()
    transcript.say(f"{date.today()}, {processors.model()}, {options.threads} thread(s), {versions()}")
    transcript.say()
    transcript.say(f"{'what':<46} {'ours':>9} {'peer':>9} {'ratio':>7}  {'peer':<26} same answer?")
    for story in options.only.split(","):
        for row in importlib.import_module(f"peers.speed.{story}").rows(options):
            transcript.say(row)
    transcript.write(options.output)


def versions():
    from importlib.metadata import PackageNotFoundError, version

    import cfreg

    found = [f"cfreg {cfreg.__version__}"]
    for name in ("numpy", "scipy", "pykeops", "torch", "open3d", "kiss-matcher", "small_gicp"):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"no {name}")
    return ", ".join(found)


if __name__ == "__main__":
    sys.exit(main())
