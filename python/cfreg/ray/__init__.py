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

import importlib
import json
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .. import _native, batch
from ..batch_results import BatchSummary
from ..methods import Method, _made
from ..methods.base import Refinements, _refinements

__all__ = ["register_batch"]

FACTS = "_cfreg.json"
"""File of the folder that has what its rows were asked for by; readers of Parquet pass it over."""


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
        raise _native.SettingError(f"block = {block!r}: must be a whole number, at least 1")
    names, folder = _listed(pairs, folder)
    rows = {key: value for key, value in how.items() if key not in ("refine", "memory")}
    facts = {
        "cfreg": _native.__version__,
        "pairs": names,
        "folder": folder,
        "method": [chosen._named(), *_refinements(refine)],
        **rows,
    }
    place = _Place(output)
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
            _block, batch_size=None, batch_format="pyarrow", num_cpus=1, fn_kwargs=work
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
        local = _fetched(name, room) if "://" in name else name
        return _native.read_list(local), _absolute(own if folder is None else folder)


def _absolute(folder: str | os.PathLike[str]) -> str:
    """A folder as all machines see it."""
    name = os.fspath(folder)
    return name if "://" in name else os.path.abspath(name)


def _block(
    pairs: Any, method: Method, folder: str, **how: Any
) -> Any:
    """The rows of some pairs: what a task does."""
    pyarrow: Any = importlib.import_module("pyarrow")
    index, source, target = (pairs[name].to_pylist() for name in ("index", "source", "target"))
    with tempfile.TemporaryDirectory(prefix="cfreg-") as room:
        files = {name: _file(folder, name, room) for name in {*source, *target}}
        there = [(files[a][0], files[b][0]) for a, b in zip(source, target)]
        found = batch.register_batch(there, method, threads=1, **how).to_arrow()
    errors = found["error"].to_pylist()
    for row, error in enumerate(errors):
        for name in (source[row], target[row]):
            file, failure = files[name]
            if error is not None and file != name:
                error = failure or error.replace(file, _joined(folder, name))
        errors[row] = error
    columns = {"index": index, "source": source, "target": target, "error": errors}
    for name, column in columns.items():
        field = found.schema.field(name)
        at = found.schema.get_field_index(name)
        found = found.set_column(at, field, pyarrow.array(column, field.type))
    return found


def _joined(folder: str, name: str) -> str:
    if "://" in name:
        return name
    return f"{folder.rstrip('/')}/{name}" if "://" in folder else os.path.join(folder, name)


def _file(folder: str, name: str, room: str) -> tuple[str, str | None]:
    """The file of a cloud on this machine, and why there is none."""
    place = _joined(folder, name)
    if "://" not in place:
        return place, None
    try:
        return _fetched(place, room), None
    except OSError as failure:
        return os.path.join(room, "none"), f"{place}: {failure}"


def _fetched(place: str, room: str) -> str:
    """A file of object storage, copied into the folder `room`."""
    fs: Any = importlib.import_module("pyarrow.fs")
    files, path = fs.FileSystem.from_uri(place)
    local = os.path.join(room, f"{len(os.listdir(room))}-{place.rpartition('/')[2]}")
    with files.open_input_stream(path) as stream, open(local, "wb") as copy:
        copy.write(stream.read())
    return local


def _digest(facts: dict[str, Any]) -> dict[str, Any]:
    """Facts to be compared: of the pairs their number, and one that differs between lists."""
    import hashlib

    names = json.dumps(facts.pop("pairs")).encode()
    return {**json.loads(json.dumps(facts)), "list": hashlib.sha256(names).hexdigest()}


class _Place:
    """The folder of the rows, here or in object storage."""

    def __init__(self, output: str | os.PathLike[str]) -> None:
        fs: Any = importlib.import_module("pyarrow.fs")
        self.name = os.fspath(output)
        if "://" in self.name:
            self.files, self.path = fs.FileSystem.from_uri(self.name)
        else:
            self.files, self.path = fs.LocalFileSystem(), os.path.abspath(self.name)

    def parts(self) -> list[str]:
        """Files of rows, whole or not."""
        fs: Any = importlib.import_module("pyarrow.fs")
        there = self.files.get_file_info(fs.FileSelector(self.path, allow_not_found=True))
        return sorted(file.path for file in there if file.path.endswith(".parquet"))

    def begin(self, facts: dict[str, Any], resume: bool, overwrite: bool) -> set[int]:
        """Makes room for a run, and says which pairs have their rows already."""
        fs: Any = importlib.import_module("pyarrow.fs")
        refused = _native.SettingError
        if resume and overwrite:
            raise refused("resume = True: contradicts overwrite: choose one of them")
        kind = self.files.get_file_info(self.path).type
        if kind == fs.FileType.File:
            raise refused(f"output = {self.name}: is a file: name a folder")
        if kind == fs.FileType.NotFound:
            self.files.create_dir(self.path, recursive=True)
        file = f"{self.path}/{FACTS}"
        begun = None
        if self.files.get_file_info(file).type == fs.FileType.File:
            with self.files.open_input_stream(file) as stream:
                begun = json.loads(stream.read())
        parts = self.parts()
        if begun is None and parts:
            rule = "has Parquet that is not of this program: name another folder"
            raise refused(f"output = {self.name}: {rule}")
        if begun is not None and not (resume or overwrite):
            rule = "an earlier run has left rows: go on with resume, or begin anew with overwrite"
            raise refused(f"output = {self.name}: {rule}")
        if begun is not None and resume:
            for name in facts:
                if begun.get(name) != facts[name]:
                    rule = f"was begun with {name} {begun.get(name)}, and this is {facts[name]}"
                    raise refused(f"resume = True: {self.name} {rule}: run it as it was begun")
            return {index for part in parts for index in self._kept(part)}
        for part in parts:
            self.files.delete_file(part)
        with self.files.open_output_stream(file) as stream:
            stream.write(json.dumps(facts).encode())
        return set()

    def _kept(self, part: str) -> list[int]:
        """Pairs of a file; one that was cut short is removed."""
        pyarrow: Any = importlib.import_module("pyarrow")
        parquet: Any = importlib.import_module("pyarrow.parquet")
        try:
            found = parquet.read_table(part, columns=["index"], filesystem=self.files, partitioning=None)
            index: list[int] = found["index"].to_pylist()
            return index
        except pyarrow.ArrowInvalid:
            self.files.delete_file(part)
            return []

    def summary(self, pairs: int, resumed: int) -> BatchSummary:
        """What is there now; every pair must have one row."""
        parquet: Any = importlib.import_module("pyarrow.parquet")
        trusted = errors = 0
        seen: set[int] = set()
        rows = 0
        for part in self.parts():
            columns = ["index", "trusted", "error"]
            found = parquet.read_table(part, columns=columns, filesystem=self.files, partitioning=None)
            rows += len(found)
            seen.update(found["index"].to_pylist())
            trusted += sum(bool(value) for value in found["trusted"].to_pylist())
            errors += len(found) - found["error"].null_count
        if rows != pairs or len(seen) != pairs:
            rule = f"{rows} rows of {len(seen)} pairs, of {pairs}: was the folder changed?"
            raise _native.Error(f"{self.name}: {rule}")
        return BatchSummary(pairs, resumed, trusted, errors)
