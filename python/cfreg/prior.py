"""What is known of a pose beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _native

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["Prior"]


@dataclass(frozen=True, kw_only=True)
class Prior:
    """What is known of a pose beforehand; what is given holds exactly, in every closed form.

    direction : three numbers, an axis that the rotation is about ((0, 0, 1) leaves the yaw
        alone); or two directions, one in the source's frame and the same one in the target's,
        as gravity where both were measured
    rotation : rotation, source into target frame, that is known or near: its vector in radians,
        or the matrix (3, 3)
    within_deg : largest angle to it, degrees; 0, the default, where it is known
    scale : least and largest scale, of a method that estimates one

    Examples
    --------
    >>> import cfreg, numpy as np
    >>> points = np.random.default_rng(0).random((300, 3))
    >>> upright = cfreg.Prior(direction=(0, 0, 1))
    >>> found = cfreg.ICP(prior=upright).register(points, points + 0.01)
    >>> bool(np.allclose(found.transform[:3, 2], (0, 0, 1)))
    True
    """

    direction: Sequence[float] | Sequence[Sequence[float]] | None = None
    rotation: npt.ArrayLike | None = None
    within_deg: float = 0.0
    scale: Sequence[float] | None = None

    def __post_init__(self) -> None:
        # Tuples compare.
        for name in ("direction", "rotation", "scale"):
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                rows = value.tolist()
                tuples = tuple(tuple(row) for row in rows) if value.ndim == 2 else tuple(rows)
                object.__setattr__(self, name, tuples)

    def _facts(self) -> dict[str, Any]:
        """As the settings of methods have it."""
        direction: list[list[float | str]] | None = None
        if self.direction is not None:
            given = _numbers(self.direction, "direction", [(3,), (2, 3)], "three numbers, or two times three")
            ends = given if given.ndim == 2 else [given, given]
            direction = [[_number(x) for x in end] for end in ends]
        near = None
        if self.rotation is not None:
            vector = [_number(x) for x in _rotation_vector(self.rotation)]
            near = {"vector": vector, "within_deg": _number(self.within_deg)}
        scale = None
        if self.scale is not None:
            bounds = _numbers(self.scale, "scale", [(2,)], "the least and the largest scale")
            scale = [_number(x) for x in bounds]
        return {"direction": direction, "rotation": near, "scale": scale}


def _numbers(given: Any, field: str, shapes: list[tuple[int, ...]], wanted: str) -> Any:
    """An array of one of these shapes."""
    try:
        array = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        array = None
    if array is None or array.shape not in shapes:
        raise _native.SettingError(f"prior.{field} = {given!r}: must be {wanted}")
    return array


def _rotation_vector(given: Any) -> Any:
    """Of a rotation vector, or of a matrix."""
    array = _numbers(given, "rotation", [(3,), (3, 3)], "a rotation vector (3,) in radians, or a matrix (3, 3)")
    return _native.rotation_vector(array) if array.ndim == 2 else array


def _number(value: Any) -> float | str:
    """JSON has no NaN: as a word it is refused."""
    value = float(value)
    return value if abs(value) < float("inf") else str(value)
