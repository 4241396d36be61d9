"""What comes of a list of pairs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from . import _interop, _native

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["BatchResult", "BatchSummary", "read_batch"]


@dataclass(frozen=True)
class BatchSummary:
    """What came of a list whose rows were written.

    pairs : of the list
    resumed : that were there from an earlier run
    trusted : whose pose may be used (BatchResult.usable)
    errors : without a pose
    """

    pairs: int
    resumed: int
    trusted: int
    errors: int


class BatchResult:
    """The rows of a list of pairs, in its order: a column by its name, a row by its number.

    `result["probability"]` is an array with one value a pair, `result[3]` the row of a pair as a
    dict, and rows come one after the other in a loop. Columns have the names of `cfreg batch`,
    which docs/reference/output.md explains; where a row has nothing, texts are None, truths False, counts -1
    and numbers NaN.

    >>> import cfreg, numpy as np
    >>> x, y = np.random.default_rng(0).uniform(-1, 1, (2, 500))
    >>> one = np.column_stack([x, y, 0.4 * np.sin(3 * x + y) + 0.2 * x * x])
    >>> found = cfreg.register_batch([("one", "two"), ("two", "one")], clouds={"one": one, "two": -one[:, [1, 0, 2]] * [-1, 1, -1]})
    >>> found
    BatchResult(2 pairs: 2 poses to use, 0 without a pose)
    >>> found["source"].tolist(), found.transform.shape, found[1]["target"]
    (['one', 'two'], (2, 4, 4), 'one')
    """

    def __init__(self, columns: Mapping[str, tuple[str, Any]]) -> None:
        if not isinstance(columns, Mapping) or "index" not in columns:
            rule = "must be what register_batch or read_batch have found"
            raise _native.SettingError(f"columns: {rule}, not {_interop.shown(columns)}")
        self._kinds = {name: kind for name, (kind, _) in columns.items()}
        self._columns: dict[str, npt.NDArray[Any]] = {}
        for name, (kind, values) in columns.items():
            column = np.array(values, dtype=object) if kind == "text" else np.asarray(values)
            column.setflags(write=False)
            self._columns[name] = column
        self._masks: dict[str, npt.NDArray[np.bool_]] = {}

    @property
    def columns(self) -> Mapping[str, npt.NDArray[Any]]:
        """All columns by their names, in order."""
        return dict(self._columns)

    @property
    def transform(self) -> npt.NDArray[np.float64]:
        """(N, 4, 4) poses T_target_source; NaN where there is no answer."""
        entries = [self._columns[f"t{i}{j}"] for i in range(4) for j in range(4)]
        return np.stack(entries, axis=1).reshape(-1, 4, 4)

    @property
    def usable(self) -> npt.NDArray[np.bool_]:
        """(N,) whether each pose may be used: trusted, accepted where there is a verdict, finite
        and a proper rotation. `write_g2o` takes no others."""
        usable = self._columns["trusted"] & ~self._failed
        poses, decisions = self.transform, self._columns["decision"]
        for row in np.flatnonzero(usable):
            usable[row] = _native.is_usable(poses[row].tolist(), True, decisions[row])
        return usable

    @property
    def covariance(self) -> npt.NDArray[np.float64]:
        """(N, 6, 6) covariances (see PoseCovariance), about the columns `center_x` to `center_z`;
        NaN where there is none."""
        return self._symmetric("cov")

    @property
    def information(self) -> npt.NDArray[np.float64]:
        """(N, 6, 6) their inverses, but 0 along motions that nothing holds."""
        return self._symmetric("info")

    def write_g2o(
        self,
        path: str | os.PathLike[str],
        *,
        rotations: str = "quaternion",
        names: str | os.PathLike[str] | None = None,
    ) -> str:
        """Write the poses that may be used as a graph of poses, as `cfreg graph` does.

        rotations : by what the reader measures them, "quaternion" (g2o) or "vector" (GTSAM)
        names : file for the names of the clouds by their vertices, CSV

        Returns in words what is in the graph.
        """
        rows = "\n".join(json.dumps(row) for row in self)
        clouds, parts, edges, refused, left_out = _native.write_g2o(path, rows, rotations, names)
        return (
            f"{clouds} clouds in {parts} parts, {edges} edges; "
            f"{refused} poses not accepted, {left_out} left out"
        )

    def to_arrow(self) -> Any:
        """A table of pyarrow with the columns and types of `cfreg batch`'s Parquet."""
        pyarrow: Any = import_module("pyarrow")
        kinds = {"text": pyarrow.string(), "flag": pyarrow.bool_(), "count": pyarrow.int64(), "number": pyarrow.float64()}
        columns = {
            name: pyarrow.array(column, kinds[self._kinds[name]], mask=self._missing(name))
            for name, column in self._columns.items()
        }
        return pyarrow.table(columns)

    def to_pandas(self) -> Any:
        """A data frame of pandas, missing values as pandas has them."""
        pandas: Any = import_module("pandas")
        kinds = {"flag": "boolean", "count": "Int64"}
        columns = {}
        for name, column in self._columns.items():
            series = pandas.Series(column)
            if self._kinds[name] in kinds:
                series = series.astype(kinds[self._kinds[name]]).mask(self._missing(name))
            columns[name] = series
        return pandas.DataFrame(columns)

    def __len__(self) -> int:
        return len(self._columns["index"])

    @overload
    def __getitem__(self, key: str) -> npt.NDArray[Any]: ...
    @overload
    def __getitem__(self, key: int) -> dict[str, Any]: ...
    def __getitem__(self, key: str | int) -> Any:
        if isinstance(key, str):
            return self._columns[key]
        row = range(len(self))[key]
        return {name: None if self._missing(name)[row] else _plain(column[row]) for name, column in self._columns.items()}

    def __iter__(self) -> Iterator[dict[str, Any]]:
        columns = []
        for name, column in self._columns.items():
            values = column.astype(object)
            values[self._missing(name)] = None
            columns.append(values.tolist())
        for row in zip(*columns):
            yield dict(zip(self._columns, row))

    def __repr__(self) -> str:
        trusted = int(self.usable.sum())
        return f"BatchResult({len(self)} pairs: {trusted} poses to use, {int(self._failed.sum())} without a pose)"

    @property
    def _failed(self) -> npt.NDArray[np.bool_]:
        return ~self._none("error")

    def _none(self, name: str) -> npt.NDArray[np.bool_]:
        return np.array([value is None for value in self._columns[name]], dtype=bool)

    def _missing(self, name: str) -> npt.NDArray[np.bool_]:
        """Where a row has nothing in a column."""
        if name not in self._masks:
            column, kind = self._columns[name], self._kinds[name]
            if kind == "text":
                self._masks[name] = self._none(name)
            elif kind == "flag":
                self._masks[name] = self._failed
            else:
                self._masks[name] = column == -1 if kind == "count" else np.isnan(column)
        return self._masks[name]

    def _symmetric(self, name: str) -> npt.NDArray[np.float64]:
        """(N, 6, 6) of an upper triangle."""
        entries = [self._columns[f"{name}{min(i, j)}{max(i, j)}"] for i in range(6) for j in range(6)]
        return np.stack(entries, axis=1).reshape(-1, 6, 6)


def read_batch(path: str | os.PathLike[str]) -> BatchResult:
    """Read results of `cfreg batch`, or of register_batch, that were written.

    path : .csv, .jsonl or .parquet, or a folder with .parquet in it, as clusters write them

    Raises FileFormatError, with the line or row and the column, for what are no such results.
    """
    return BatchResult(_native.read_batch(path))


def _plain(value: Any) -> Any:
    """A number of Python for one of numpy."""
    return value.item() if isinstance(value, np.generic) else value
