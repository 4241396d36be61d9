"""The method for clouds of which nothing is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..prior import Prior
from .base import Method


@dataclass(frozen=True, kw_only=True, repr=False)
class Consensus(Method):
    """Scans that overlap in part: matches that agree with each other, judged on the surfaces.

    Its results have a `verdict`: how probable the pose is, why, and what else it might be.

    voxel : the length that all others follow from, in the unit of the clouds, which are
        thinned to one point per cube of this side. None: such that 5000 points are left of
        the cloud where it is longer
    seeds : matches from which a pose is sought, at least 1; more find smaller overlaps
    prior : cfreg.Prior, what is known of the pose beforehand

    >>> import cfreg
    >>> cfreg.Consensus().voxel is None
    True
    """

    name: ClassVar[str] = "consensus"
    voxel: float | None = None
    seeds: int = 200
    prior: Prior | None = None
    threads: int = 0
