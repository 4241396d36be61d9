"""What is known of a pose beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

__all__ = ["Prior"]


@dataclass(frozen=True, kw_only=True)
class Prior:
    """What is known of a pose beforehand; what is given holds exactly, in every closed form.

    direction : three numbers, an axis that the rotation is about ((0, 0, 1) leaves the yaw
        alone); or two directions, one in the source's frame and the same one in the target's,
        as gravity where both were measured
    rotation : rotation vector in radians, source into target frame, that is known or near
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
    rotation: Sequence[float] | None = None
    within_deg: float = 0.0
    scale: Sequence[float] | None = None

    def _facts(self) -> dict[str, Any]:
        """As the settings of methods have it."""
        direction: list[list[float | str]] | None = None
        if self.direction is not None:
            given: Any = self.direction
            ends = given if hasattr(given[0], "__len__") else [given, given]
            direction = [[_number(x) for x in end] for end in ends]
        near = None
        if self.rotation is not None:
            vector = [_number(x) for x in self.rotation]
            near = {"vector": vector, "within_deg": _number(self.within_deg)}
        scale = None if self.scale is None else [_number(x) for x in self.scale]
        return {"direction": direction, "rotation": near, "scale": scale}


def _number(value: Any) -> float | str:
    """JSON has no NaN: as a word it is refused."""
    value = float(value)
    return value if abs(value) < float("inf") else str(value)
