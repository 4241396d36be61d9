"""Pairs in bulk on a cluster: `cfreg.register_batch` by Ray Data. Needs `pip install cfreg[ray]`.

The list is cut into blocks; each is one task of Ray on one core, which reads its clouds,
registers its pairs and writes their rows as one Parquet file into the folder `output`. Ray decides
which machine does what, and does again what was lost with a machine. Rows are those of one machine,
whatever the cluster: `index` says where they belong, and `cfreg graph` reads the folder as it is.

Files are local paths that every machine sees, or URIs of object storage that pyarrow knows
(s3://bucket/scan.ply, gs://...), for list, clouds and output alike. `python -m cfreg.ray` is this
as a command.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .. import _interop, _native, batch
from ..batch_results import BatchSummary
from ..methods import Method, _made
from ..methods.base import Refinements, _refinements
from .block import fetched, registered
from .place import Place

__all__ = ["register_batch"]


def register_batch(
    pairs: str | os.PathLike[str] | Iterable[tuple[str, str]],
    output: str | os.PathLike[str],
    method: str | Method = "consensus",
    *,
    resume: bool = False,
    overwrite: bool = False,
    refine: Refinements = (),
    folder: str | os.PathLike[str] | None = None,
    viewpoints: str = "file",
    voxel: float | None = None,
    sample: int | None = None,
    seed: int = 0,
    memory: int = 1 << 30,
    time_limit: float | None = None,
    times: bool = False,
    block: int = 64,
    **settings: Any,
) -> BatchSummary:
    """Register a list of pairs on the cluster that Ray is connected to, or on this machine.

    Parameters
    ----------
    pairs : a list, CSV or Parquet with the columns source and target, or pairs of files
    output : folder that Parquet is written into, a file a block
    resume : go on where an earlier run ended, and do only what is missing
    overwrite : remove what an earlier run has left, and begin anew
    folder : what files are relative to. None: the folder of the list, else the current one
    block : pairs of a task. Pairs of the same cloud should stand together in the list: a task
        reads each of its clouds once. Fewer lose less with a machine, and read more
    memory : bytes of clouds that a task keeps
    method, refine, viewpoints, voxel, sample, seed, time_limit, times, settings : see
        cfreg.register_batch

    Returns
    -------
    BatchSummary : numbers of pairs

    Raises
    ------
    SettingError : a setting out of its range, or an earlier run that is in the way of `output`
    FileFormatError, OSError : a list that cannot be read
    """
    data: Any = importlib.import_module("ray.data")
    pyarrow: Any = importlib.import_module("pyarrow")
    chosen = _made(method, settings)
    how: dict[str, Any] = {
        "refine": refine,
        "viewpoints": viewpoints,
        "voxel": voxel,
        "sample": sample,
        "seed": seed,
        "memory": memory,
        "time_limit": time_limit,
        "times": times,
    }
    # What will not do is refused here, and not by every task.
    batch.register_batch([], chosen, **how)
    if not isinstance(block, int) or block < 1:
        raise _native.SettingError(f"block = {_interop.shown(block)}: must be a whole number, at least 1")
    names, folder = _listed(pairs, folder)
    facts = {
        "cfreg": _native.__version__,
        "pairs": names,
        "folder": folder,
        "method": [chosen._named(), *_refinements(refine)],
        # Memory changes no row.
        **{name: value for name, value in how.items() if name not in ("refine", "memory")},
    }
    place = Place(output)
    done = place.begin(_digest(facts), resume, overwrite)
    missing = [index for index in range(len(names)) if index not in done]
    if missing:
        blocks = [missing[at : at + block] for at in range(0, len(missing), block)]
        tables = [
            pyarrow.table(
                {
                    "index": pyarrow.array(numbers, pyarrow.int64()),
                    "source": [names[number][0] for number in numbers],
                    "target": [names[number][1] for number in numbers],
                }
            )
            for numbers in blocks
        ]
        work = {"method": chosen, "folder": folder, **how}
        found = data.from_arrow(tables).map_batches(
            registered, batch_size=None, batch_format="pyarrow", num_cpus=1, fn_kwargs=work
        )
        found.write_parquet(place.path, filesystem=place.files)
    return place.summary(len(names), len(done))


def _listed(pairs: Any, folder: Any) -> tuple[list[tuple[str, str]], str]:
    """Pairs by their names, and what these are relative to."""
    if not isinstance(pairs, (str, os.PathLike)):
        names = [(os.fspath(source), os.fspath(target)) for source, target in pairs]
        return names, _absolute(folder or "")
    name = os.fspath(pairs)
    own = name.rpartition("/")[0] if "://" in name else Path(name).parent
    with tempfile.TemporaryDirectory() as room:
        local = fetched(name, room) if "://" in name else name
        return _native.read_list(local), _absolute(own if folder is None else folder)


def _absolute(folder: str | os.PathLike[str]) -> str:
    """A folder as all machines see it."""
    name = os.fspath(folder)
    return name if "://" in name else os.path.abspath(name)


def _digest(facts: dict[str, Any]) -> dict[str, Any]:
    """Facts to be compared: of the pairs their number, and one that differs between lists."""
    names = json.dumps(facts.pop("pairs")).encode()
    return {**json.loads(json.dumps(facts)), "list": hashlib.sha256(names).hexdigest()}
