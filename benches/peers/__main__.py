"""Measures the package and its peers in turn, and prints one table.

    python -m peers                      all, one thread
    python -m peers --threads 2 --only poses
"""

import argparse
import importlib
import os
import platform
import sys
from datetime import date
from pathlib import Path

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
    # KISS-Matcher takes as many as it may run on.
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.threads])
    lines = []

    def say(line=""):
        print(line, flush=True)
        lines.append(line)

    say(f"{date.today()}, {cpu()}, {options.threads} thread(s), {versions()}")
    say()
    say(f"{'what':<46} {'ours':>9} {'peer':>9} {'ratio':>7}  {'peer':<26} same answer?")
    for story in options.only.split(","):
        for row in importlib.import_module(f"peers.{story}").rows(options):
            say(row)
    if options.output:
        options.output.write_text("\n".join(lines) + "\n")


def cpu():
    try:
        facts = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    model = next((line.split(": ")[1] for line in facts if line.startswith("model name")), "")
    flags = next((line.split(": ")[1].split() for line in facts if line.startswith("flags")), [])
    return model + "".join(f" {name}" for name in ("avx2", "avx512f") if name in flags)


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
