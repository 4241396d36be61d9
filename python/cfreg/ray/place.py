"""The folder that rows are written into, on disks that all machines see or in object storage."""

from __future__ import annotations

import importlib
import json
import os
from typing import Any

from .. import _native
from ..batch_results import BatchSummary

__all__ = ["Place"]

FACTS = "_cfreg.json"
"""File of the folder that has what its rows were asked for by; readers of Parquet pass it over."""


class Place:
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
