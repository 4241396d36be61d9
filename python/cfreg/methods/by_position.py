"""Methods that weigh connections by position, and start from a pose."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, ClassVar

from .. import _native
from ..prior import Prior
from .base import LocalMethod


@dataclass(frozen=True, kw_only=True, repr=False)
class ICP(LocalMethod):
    """Iterative closest point: finds the nearest rest, from within about 20 degrees.

    metric : "point", "plane" or "generalized"
    max_distance : longest pair, in the target's unit. None: every source point has a pair
    keep : share of the pairs that is kept, shortest first, above 0 to 1
    reciprocal : whether the source point must be the nearest of its target point too
    weights : kernel of a pair's distance, by name
    bandwidth : of the kernel, in the target's unit. None: three resolutions
    surface_neighbors : nearest points that make a tangent plane ("plane", "generalized")
    max_iterations : at least 1; at the limit the pose has a warning
    rotation_tolerance, translation_tolerance : step below which it rests, in radians and in
        radii of the target
    relative_error_tolerance, error_tolerance : change of the mean squared distance below
        which it rests
    prior : cfreg.Prior, what is known of the pose beforehand
    trace : whether to record every iteration
    """

    name: ClassVar[str] = "icp"
    metric: str = "point"
    max_distance: float | None = None
    keep: float = 1.0
    reciprocal: bool = False
    weights: str = "uniform"
    bandwidth: float | None = None
    surface_neighbors: int = 20
    max_iterations: int = 200
    rotation_tolerance: float = 1e-6
    translation_tolerance: float = 1e-6
    relative_error_tolerance: float = 0.0
    error_tolerance: float = 0.0
    prior: Prior | None = None
    trace: bool = False
    threads: int = 0

    @classmethod
    def plane(cls, **settings: Any) -> ICP:
        """Point to plane."""
        return cls(**{"metric": "plane", **settings})

    @classmethod
    def generalized(cls, **settings: Any) -> ICP:
        """Generalized ICP: disc to disc."""
        return cls(**{"metric": "generalized", **settings})

    @classmethod
    def paper(cls, **settings: Any) -> ICP:
        """The paper's settings, as PCL understands them: pairs of at most 0.5."""
        papers = json.loads(_native.settings("icp-paper", "{}"))
        del papers["method"]
        return cls(**{**papers, **settings})


@dataclass(frozen=True, kw_only=True, repr=False)
class KC(LocalMethod):
    """Kernel Correlation: positions weighed by a Gaussian that shrinks.

    sigma, last_sigma : first and last bandwidth, in the target's unit. None: from the clouds
    factor : by which it shrinks, above 0 and below 1
    tolerance : step below which a bandwidth is done with
    max_iterations : of each bandwidth, at least 1
    prior : cfreg.Prior, what is known of the pose beforehand
    trace : whether to record every iteration
    """

    name: ClassVar[str] = "kc"
    sigma: float | None = None
    last_sigma: float | None = None
    factor: float = 0.7
    tolerance: float = 1e-6
    max_iterations: int = 50
    prior: Prior | None = None
    trace: bool = False
    threads: int = 0


@dataclass(frozen=True, kw_only=True, repr=False)
class CPD(LocalMethod):
    """Coherent Point Drift, rigid.

    outliers : share of points that belong to nothing, 0 to below 1
    scale : "fixed", "umeyama" or "symmetric"
    sigma : first bandwidth, in the target's unit. None: from the clouds
    tolerance : change of the likelihood below which it rests
    max_iterations : at least 1
    truncation : share of a weight below which pairs are left out
    prior : cfreg.Prior, what is known of the pose beforehand
    trace : whether to record every iteration
    """

    name: ClassVar[str] = "cpd"
    outliers: float = 0.1
    scale: str = "fixed"
    sigma: float | None = None
    tolerance: float = 1e-6
    max_iterations: int = 150
    truncation: float = 1e-7
    prior: Prior | None = None
    trace: bool = False
    threads: int = 0


@dataclass(frozen=True, kw_only=True, repr=False)
class DARE(LocalMethod):
    """Density-adaptive registration: both clouds to a latent mixture.

    components : of the mixture. None: from the clouds
    max_iterations : at least 1
    outlier_ratio : share of points that belong to nothing
    density_neighbors : nearest points that tell the density; 0 for none
    tolerance : change of the likelihood below which it rests
    initial_sigma, min_sigma : first and least bandwidth, in radii of the clouds
    prior : cfreg.Prior, what is known of the pose beforehand
    trace : whether to record every iteration
    """

    name: ClassVar[str] = "dare"
    components: int | None = None
    max_iterations: int = 1000
    outlier_ratio: float = 0.005
    density_neighbors: int = 10
    tolerance: float = 1e-5
    initial_sigma: float = 3.0
    min_sigma: float = 0.065
    prior: Prior | None = None
    trace: bool = False
    threads: int = 0
