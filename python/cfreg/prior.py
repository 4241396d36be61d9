"""What is known of a pose beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _interop, _native

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
        or the matrix (3, 3). A matrix that rounding has taken away from a rotation, by up to 1e-4, is
        replaced by the nearest rotation; `rotation_error` is how far it was off
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

    @property
    def rotation_error(self) -> float:
        """How far `rotation` is from the rotation that is taken: the Frobenius norm of the difference, at
        most 1e-4; 0 for a vector, or where no rotation is given.

        An attribute, and no warning: matrices in float32, which are all off by 1e-7, would warn each
        time. SettingError where it is no rotation.

        >>> import cfreg, numpy as np
        >>> round(cfreg.Prior(rotation=1.00001 * np.eye(3)).rotation_error, 8)
        1.732e-05
        """
        return 0.0 if self.rotation is None else _rotation(self.rotation)[1]

    def _facts(self) -> dict[str, Any]:
        """As the settings of methods have it."""
        direction: list[list[float | str]] | None = None
        if self.direction is not None:
            given = _numbers(self.direction, "direction", [(3,), (2, 3)], "three numbers, or two times three")
            ends = given if given.ndim == 2 else [given, given]
            direction = [[_number(x) for x in end] for end in ends]
        near = None
        if self.rotation is not None:
            vector = [_number(x) for x in _rotation(self.rotation)[0]]
            near = {"vector": vector, "within_deg": _within(self.within_deg)}
        scale = None
        if self.scale is not None:
            bounds = _numbers(self.scale, "scale", [(2,)], "the least and the largest scale")
            scale = [_number(x) for x in bounds]
        return {"direction": direction, "rotation": near, "scale": scale}


def _numbers(given: Any, field: str, shapes: list[tuple[int, ...]], wanted: str) -> Any:
    """An array of one of these shapes."""
    array: Any
    try:
        array = np.asarray(given)
        array = array.astype(float) if array.dtype.kind in "iufO" else None
    except (TypeError, ValueError, OverflowError):
        array = None
    if array is None or array.shape not in shapes:
        raise _native.SettingError(f"prior.{field} = {_interop.shown(given)}: must be {wanted}")
    return array


def _rotation(given: Any) -> tuple[Any, float]:
    """The vector of a rotation vector, or of a matrix, and how far the matrix is off."""
    wanted = "a rotation vector (3,) in radians, or a matrix (3, 3)"
    array = _numbers(given, "rotation", [(3,), (3, 3)], wanted)
    return _native.rotation_vector(array) if array.ndim == 2 else (array, 0.0)


def _within(value: Any) -> float | str:
    """An angle in degrees."""
    try:
        return _number(value)
    except (TypeError, ValueError, OverflowError):
        rule = "must be an angle in degrees"
        raise _native.SettingError(f"prior.within_deg = {_interop.shown(value)}: {rule}") from None


def _number(value: Any) -> float | str:
    """JSON has no NaN: as a word it is refused."""
    value = float(value)
    return value if abs(value) < float("inf") else str(value)
