"""The crate beside the reference, exact arithmetic and Open3D, a module a story.

Each has `BOUNDS`, quantity to (the greatest value allowed, why it may be that large), and
`sections(scope)`, which yields a title and an iterable of (quantity, who, value).
Quantities without a bound are printed for information.
"""

from dataclasses import dataclass
from types import ModuleType


@dataclass(frozen=True)
class Scope:
    cfreg: ModuleType | None
    """The crate's module; None leaves it out."""
    points: int
    """Most points of a cloud of the pipeline's stages."""
