"""`python -m cfreg.ray PAIRS OUTPUT`: a list of pairs on the cluster that Ray is started with."""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from typing import Any

from .. import Error
from . import register_batch


def setting(text: str) -> tuple[str, Any]:
    """NAME=VALUE, the value as JSON where it is, else as a text."""
    name, equals, value = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{text}: must be NAME=VALUE")
    try:
        return name, json.loads(value)
    except json.JSONDecodeError:
        return name, value


def main() -> int:
    """0 once every pair has its row, those without a pose too; 2 when that could not be."""
    parser = argparse.ArgumentParser(prog="python -m cfreg.ray", description=__doc__)
    add = parser.add_argument
    add("pairs", help="list: CSV or Parquet with the columns source and target, a path or a URI")
    add("output", help="folder for the rows, Parquet, a path or a URI")
    add("--address", help="of the cluster [default: the one this machine is in, else a new one here]")
    add("--method", default="consensus", help="refinements may follow after +: consensus+gicp")
    add("--set", type=setting, action="append", default=[], metavar="NAME=VALUE", help="setting of the method")
    add("--folder", help="what files are relative to [default: the folder of the list]")
    add("--viewpoints", default="file", help="file, origin or none")
    add("--voxel", type=float, help="one point a cube of this side; for consensus its length")
    add("--sample", type=int, help="points kept of each cloud, at random")
    add("--seed", type=int, default=0, help="of --sample")
    add("--time-limit", type=float, metavar="SECONDS", help="after which a pair is given up")
    add("--times", action="store_true", help="add the column seconds")
    add("--block", type=int, default=64, help="pairs of a task [default: 64]")
    add("--resume", action="store_true", help="go on where an earlier run ended")
    add("--overwrite", action="store_true", help="begin anew")
    given = vars(parser.parse_args())
    ray: Any = importlib.import_module("ray")
    try:
        ray.init(address=given.pop("address"), ignore_reinit_error=True)
        method, *refine = given.pop("method").split("+")
        settings = dict(given.pop("set"))
        done = register_batch(method=method, refine=refine, **given, **settings)
    except (Error, OSError) as error:
        print(f"cfreg: {error}", file=sys.stderr)
        return 2
    print(f"{done.pairs} pairs: {done.trusted} poses to use, {done.errors} without a pose", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
