"""Pairs in bulk: a list of pairs, a row of results for each."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Union, cast, overload

import numpy as np

from . import _interop, _native
from .batch_results import BatchResult, BatchSummary
from .methods import CF, Consensus, CustomMethod, Method, _custom_named, _is_custom, _made
from .methods.base import Refinements, _options, _refinements

__all__ = ["register_batch"]

Pairs = Union[str, "os.PathLike[str]", Iterable[tuple[Any, Any]]]
"""A file with a list, or pairs of files, names and clouds."""

Progress = Callable[[int, int], object]
"""Is told the pairs done and all of them."""


@overload
def register_batch(
    pairs: Pairs,
    method: str | Method | CustomMethod = "consensus",
    *,
    output: None = None,
    refine: Refinements = (),
    clouds: Mapping[str, Any] | None = None,
    folder: str | os.PathLike[str] | None = None,
    viewpoints: str = "file",
    verdict: bool | str = "auto",
    keep_no_returns: bool = False,
    voxel: float | None = None,
    sample: int | None = None,
    seed: int = 0,
    threads: int = 0,
    memory: int = 1 << 30,
    time_limit: float | None = None,
    times: bool = False,
    progress: Progress | None = None,
    **settings: Any,
) -> BatchResult: ...
@overload
def register_batch(
    pairs: Pairs,
    method: str | Method | CustomMethod = "consensus",
    *,
    output: str | os.PathLike[str],
    resume: bool = False,
    overwrite: bool = False,
    refine: Refinements = (),
    clouds: Mapping[str, Any] | None = None,
    folder: str | os.PathLike[str] | None = None,
    viewpoints: str = "file",
    verdict: bool | str = "auto",
    keep_no_returns: bool = False,
    voxel: float | None = None,
    sample: int | None = None,
    seed: int = 0,
    threads: int = 0,
    memory: int = 1 << 30,
    time_limit: float | None = None,
    times: bool = False,
    progress: Progress | None = None,
    **settings: Any,
) -> BatchSummary: ...
def register_batch(
    pairs: Pairs,
    method: str | Method | CustomMethod = "consensus",
    *,
    output: str | os.PathLike[str] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    refine: Refinements = (),
    clouds: Mapping[str, Any] | None = None,
    folder: str | os.PathLike[str] | None = None,
    viewpoints: str = "file",
    verdict: bool | str = "auto",
    keep_no_returns: bool = False,
    voxel: float | None = None,
    sample: int | None = None,
    seed: int = 0,
    threads: int = 0,
    memory: int = 1 << 30,
    time_limit: float | None = None,
    times: bool = False,
    progress: Progress | None = None,
    **settings: Any,
) -> BatchResult | BatchSummary:
    """Register a list of pairs beside each other, each on one thread: the rows of `cfreg batch`.

    Each cloud is read once and kept for its other pairs, with what the method makes of it alone. What is wrong with a pair, a file that
    cannot be read, clouds without a pose, is the `error` of its row; the others go on.

    Parameters
    ----------
    pairs : (source, target) pairs of files, of names in `clouds`, or of clouds of any kind that
        register takes; or the file of a list, CSV or Parquet with the columns source and target.
        A cloud that comes in many pairs should be the same object in all of them
    method, refine, settings : see register. `threads` of a method has no effect. A method of your
        own gets each pair as two PointCloud objects, on several threads unless `threads` is 1;
        what it raises is the `error` of the row
    output : file to write the rows to, .csv, .jsonl or .parquet, instead of returning them;
        until all are there they are in a journal beside it
    resume : go on from the journal of a run that was cut short, to the same bytes; one of other
        settings is refused, which CSV and JSON Lines have in a file beside them
    overwrite : begin anew, whatever is there
    clouds : clouds by the names that pairs have for them
    folder : what files are relative to. None: the folder of the list, else the current one
    viewpoints : where sensors stood: "file" (where the clouds say), "origin" (at the zero of their
        frames, where they do not), "none" (unknown, whatever they say)
    verdict : whether poses of methods without a verdict of their own are verified, by a search
        like that of "consensus": True ("on"), False ("off"), or "auto": but for those of "cf",
        "icp", "plane-icp" and "gicp", for which a verdict takes longer than the registration
    keep_no_returns : keep rows that mark measurements without a return, 20 or more at exactly one
        place, mostly (0, 0, 0)
    voxel : side of the cubes of which one point is kept, in the unit of the clouds; for
        "consensus" the length that all others follow from
    sample, seed : points that are kept, drawn at random after that
    threads : pairs beside each other, 0 for as many as there are cores; never changes a row
    memory : bytes of clouds, and of what was made of them, that are kept for later pairs
    time_limit : seconds after which a pair is given up, reading included. None: never
    times : add the column `seconds`, on which no two runs agree
    progress : is called with the pairs done and all of them; what it raises ends the run

    Returns
    -------
    BatchResult : the rows, as columns; or with `output` BatchSummary: numbers of pairs

    Raises
    ------
    SettingError : a setting out of its range, or an earlier run that is in the way of `output`
    FileFormatError, OSError : a list that cannot be read, an output that cannot be written
    KeyboardInterrupt : by Ctrl-C; with `output` the rows so far are kept for `resume`

    Examples
    --------
    >>> import cfreg, numpy as np
    >>> x, y = np.random.default_rng(0).uniform(-1, 1, (2, 500))
    >>> scan = np.column_stack([x, y, 0.4 * np.sin(3 * x + y) + 0.2 * x * x])
    >>> found = cfreg.register_batch([(scan, scan), (scan, "absent.ply")], "cf", refine="icp")
    >>> found["trusted"].tolist(), found["error"][1]
    ([True, False], 'absent.ply: No such file or directory (os error 2)')
    """
    custom: CustomMethod | None = None
    if _is_custom(method):
        for name, value in settings.items():
            rule = "a method of your own takes none: give it there"
            raise _native.SettingError(f"{name} = {_interop.shown(value)}: {rule}")
        custom = cast(CustomMethod, method)
        chosen: Method = Consensus()
    else:
        chosen = _made(cast("str | Method", method), settings)
    if isinstance(chosen, CF) and chosen._own_weights() is not None:
        rule = "only kernels that have a name are taken here"
        raise _native.SettingError(f"weights = {_interop.shown(chosen.weights)}: {rule}")
    if voxel is not None and custom is None and isinstance(chosen, Consensus):
        chosen, voxel = dataclasses.replace(chosen, voxel=voxel), None
    given = _by_name(clouds)
    options = {
        "threads": _count("threads", threads),
        "memory": _count("memory", memory),
        "time_limit": _number("time_limit", time_limit),
        "times": bool(times),
        "viewpoints": viewpoints,
        "voxel": _number("voxel", voxel),
        "sample": None if sample is None else _count("sample", sample),
        "seed": _count("seed", seed),
        "resume": bool(resume),
        "overwrite": bool(overwrite),
        **_options(verdict, keep_no_returns),
    }
    found = _native.register_batch(
        pairs if isinstance(pairs, (str, os.PathLike)) else _named(pairs, given),
        given,
        folder,
        chosen._named() if custom is None else _custom_named(custom),
        _refinements(refine),
        _interop.to_json(options),
        output,
        progress,
        custom,
    )
    return BatchSummary(*found) if isinstance(found, tuple) else BatchResult(found)


def _named(pairs: Iterable[tuple[Any, Any]], clouds: dict[str, Any]) -> list[tuple[str, str]]:
    """Pairs by the names of their clouds; those that have none are put into `clouds` by their
    number."""
    names: dict[int, str] = {}
    kept = []  # so that no other object takes the place of one

    def name(cloud: Any) -> str:
        if isinstance(cloud, (str, os.PathLike)):
            return os.fspath(cloud)
        if id(cloud) not in names:
            names[id(cloud)] = f"cloud {len(names)}"
            clouds[names[id(cloud)]] = cloud
            kept.append(cloud)
        return names[id(cloud)]

    if not isinstance(pairs, Iterable) or isinstance(pairs, (bytes, bytearray, memoryview)):
        rule = "pairs (source, target), or the file of a list, are needed"
        raise TypeError(f"pairs: {rule}, not {_interop.shown(pairs)}")
    found = []
    for number, pair in enumerate(pairs):
        try:
            if isinstance(pair, (str, bytes)):  # two letters are no pair
                raise TypeError
            source, target = pair
        except (TypeError, ValueError, NotImplementedError):
            given = _interop.shown(pair)
            rule = f"number {number} is not a pair (source, target), but {given}"
            raise TypeError(f"pairs: {rule}") from None
        found.append((name(source), name(target)))
    return found


def _by_name(clouds: Mapping[str, Any] | None) -> dict[str, Any]:
    """Clouds that pairs name."""
    if clouds is None:
        return {}
    if not isinstance(clouds, Mapping):
        raise TypeError(f"clouds: must be {{name: cloud}}, not {_interop.shown(clouds)}")
    for name in clouds:
        if not isinstance(name, str):
            raise TypeError(f"clouds: names must be texts, not {_interop.shown(name)}")
    return dict(clouds)


def _count(name: str, value: Any) -> int:
    if isinstance(value, (int, np.integer)) and 0 <= value < 1 << 63:
        return int(value)
    raise _native.SettingError(f"{name} = {_interop.shown(value)}: must be a whole number, at least 0")


def _number(name: str, value: Any) -> float | None:
    if value is None:
        return None
    try:
        if isinstance(value, (int, float, np.number)) and math.isfinite(value):
            return float(value)
    except (TypeError, OverflowError):  # complex numbers, and whole ones beyond all floats
        pass
    raise _native.SettingError(f"{name} = {_interop.shown(value)}: must be a number that is finite")
