"""What a task does: registers a block of pairs on one core."""

from __future__ import annotations

import importlib
import os
import tempfile
from typing import Any

from .. import batch
from ..methods import Method

__all__ = ["fetched", "registered"]


def registered(pairs: Any, method: Method, folder: str, **how: Any) -> Any:
    """The rows of some pairs, a table of pyarrow as `cfreg batch` writes it."""
    pyarrow: Any = importlib.import_module("pyarrow")
    index, source, target = (pairs[name].to_pylist() for name in ("index", "source", "target"))
    with tempfile.TemporaryDirectory(prefix="cfreg-") as room:
        files = {name: _file(folder, name, room) for name in {*source, *target}}
        there = [(files[a][0], files[b][0]) for a, b in zip(source, target)]
        found = batch.register_batch(there, method, threads=1, **how).to_arrow()
    errors = found["error"].to_pylist()
    for row, error in enumerate(errors):
        # The source last: it is read first.
        for name in (target[row], source[row]):
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
        return fetched(place, room), None
    except OSError as failure:
        return os.path.join(room, "none"), f"{place}: {failure}"


def fetched(place: str, room: str) -> str:
    """A file of object storage, copied into the folder `room`."""
    fs: Any = importlib.import_module("pyarrow.fs")
    files, path = fs.FileSystem.from_uri(place)
    local = os.path.join(room, f"{len(os.listdir(room))}-{place.rpartition('/')[2]}")
    with files.open_input_stream(path) as stream, open(local, "wb") as copy:
        copy.write(stream.read())
    return local
