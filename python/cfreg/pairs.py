"""How pairs arise: from scans in a row, from a map, and from scans that stood near each other.

Scans are whatever register_batch takes: files, names or clouds. Of two scans the later one is
the source: its pose is that in the frame of the earlier one.

>>> import cfreg
>>> cfreg.pairs.consecutive(["a.ply", "b.ply", "c.ply"])
[('b.ply', 'a.ply'), ('c.ply', 'b.ply')]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _interop, _native

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["against", "consecutive", "within"]


def consecutive(scans: Sequence[Any], steps: Sequence[int] = (1,)) -> list[tuple[Any, Any]]:
    """Each scan with those that many before it: steps of 1 are consecutive scans, 2 leaves one
    out between.

    >>> import cfreg
    >>> cfreg.pairs.consecutive("abcd", [1, 3])
    [('b', 'a'), ('c', 'b'), ('d', 'c'), ('d', 'a')]
    """
    scans, steps = _list("scans", scans), _list("steps", steps)
    for step in steps:
        if not isinstance(step, (int, np.integer)) or not 0 < step < 1 << 63:
            rule = "must be whole numbers above 0"
            raise _native.SettingError(f"steps = {_interop.shown(step)}: {rule}")
    return _of(scans, _native.consecutive(len(scans), [int(step) for step in steps]))


def against(map: Any, scans: Sequence[Any]) -> list[tuple[Any, Any]]:
    """Each scan with one map, the target of all pairs.

    >>> import cfreg
    >>> cfreg.pairs.against("map.ply", ["a.ply", "b.ply"])
    [('a.ply', 'map.ply'), ('b.ply', 'map.ply')]
    """
    return [(scan, map) for scan in _list("scans", scans)]


def within(
    scans: Sequence[Any], places: npt.ArrayLike, radius: float
) -> list[tuple[Any, Any]]:
    """All pairs of scans that stood at most `radius` from each other.

    places : (N, 3) where the scans stood, roughly, in any unit; the last columns of their poses

    >>> import cfreg
    >>> cfreg.pairs.within("abc", [(0, 0, 0), (9, 0, 0), (3, 4, 0)], 5)
    [('c', 'a')]
    """
    scans = _list("scans", scans)
    found = _interop.array(places, "places")
    if found.dtype.kind not in "iuf":
        raise _native.Error(f"places must be numbers, not {found.dtype}")
    if found.shape != (len(scans), 3):
        expected = f"expected shape ({len(scans)}, 3), one a scan"
        raise _native.ShapeError(f"places: {expected}, found {found.shape}")
    return _of(scans, _native.within(found.astype(np.float64).tolist(), radius))


def _list(name: str, given: Any) -> list[Any]:
    """The items of what is a list, or can become one; neither the names nor the bytes of what has such."""
    if not isinstance(given, (Mapping, bytes, bytearray, memoryview)) and not hasattr(given, "__dataframe__"):
        try:
            return list(given)
        except TypeError:
            pass
    raise TypeError(f"{name}: a list is needed, not {_interop.shown(given)}")


def _of(scans: Sequence[Any], pairs: Sequence[tuple[int, int]]) -> list[tuple[Any, Any]]:
    return [(scans[source], scans[target]) for source, target in pairs]
