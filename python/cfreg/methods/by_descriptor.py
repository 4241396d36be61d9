"""Methods that weigh connections by descriptors, and need no start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from .. import _interop, _native
from ..prior import Prior
from ..results import Registration
from ..weights import Kernel, Weights, _kernel
from .base import FeatureMethod, Refinements

if TYPE_CHECKING:
    import numpy.typing as npt


@dataclass(frozen=True, kw_only=True, repr=False)
class CF(FeatureMethod):
    """The paper's full connection: describe every point, connect all, solve once.

    Finds any rotation without a start where both clouds show the same surface; partial
    overlap pulls the pose away, and the result says so. `CF.multiscale()` has the best
    weights of the study: a quarter of the error at five to six times the cost.

    weights : kernel of the squared distance of descriptors: a name ("gaussian", "laplacian",
        "cauchy", "geman-mcclure", "truncated", "student-t:NU", "tukey", "uniform"), a kernel
        of cfreg.weights, or a function, see `cfreg.moments`
    beta : squared bandwidth, 1e-12 to 1e12, "auto" or "auto:SHARE". None: 100 for the
        histogram "pcl", 400 for "open3d". Only for weights that are a name
    normalize : "none", "source", "target", "both" (dual softmax), "sinkhorn:N"
    tolerance : share of the sum of weights that may be left out for speed, 0 to below 1
    solver : "arun", "horn-quaternion", "horn-matrix", "walker"; all give the same answer
    scale : "fixed", "umeyama", "symmetric"
    neighbors, radius, normal_neighbors, more_neighbors, orientation, histogram : how points
        are described: nearest points of a neighbourhood (or all within a radius), those for
        normals, more scales beside (200, or "200:50" with those for normals), where normals
        point ("viewpoint", "outward", "stored", or three numbers), whose FPFH
    channels : names of channels of both clouds to compare points by too, ("intensity:0.5",
        "red") with a share: 1, the default, matters as much as the whole shape
    given_descriptors : use of the descriptors that both clouds carry: None, "replace", "beside",
        "replace:cosine" or "beside:cosine", see FeatureMethod
    prior : cfreg.Prior, what is known of the pose beforehand

    >>> import cfreg
    >>> cfreg.CF(neighbors=100, normalize="both").beta is None
    True
    """

    name: ClassVar[str] = "cf"
    weights: str | Kernel | Weights = "gaussian"
    beta: float | str | None = None
    normalize: str = "none"
    tolerance: float = 0.0
    solver: str = "arun"
    scale: str = "fixed"
    prior: Prior | None = None
    threads: int = 0

    @classmethod
    def multiscale(cls, **settings: Any) -> CF:
        """Three scales, a bandwidth from the descriptors and dual softmax."""
        preset: dict[str, Any] = {
            "neighbors": 100,
            "normal_neighbors": 10,
            "more_neighbors": ("200:50", "400:150"),
            "histogram": "open3d",
            "normalize": "both",
        }
        if isinstance(settings.get("weights", ""), str):  # others have their own bandwidth
            preset["beta"] = "auto"
        if settings.get("radius") is not None:
            del preset["neighbors"]
        return cls(**{**preset, **settings})

    def _own_weights(self) -> Kernel | None:
        """The weights, where they are no kernel of the catalogue."""
        if isinstance(self.weights, str):
            return None
        weights = _kernel(self.weights)
        return None if _named(weights) else weights

    def _given(self) -> dict[str, Any]:
        given = super()._given()
        if isinstance(self.weights, str):
            return given
        self._only_beside_names("beta", self.beta is not None)
        named = _named(_kernel(self.weights))
        if named is not None:
            return {**given, "weights": named["kernel"], "beta": named["beta"]}
        self._only_beside_names("tolerance", self.tolerance != 0.0)
        # The compiled part knows them only while it registers.
        del given["weights"]
        return given

    def _only_beside_names(self, setting: str, given: bool) -> None:
        if given:
            rule = "only for weights that are a name; these have their own"
            value = _interop.shown(getattr(self, setting))
            raise _native.SettingError(f"{setting} = {value}: {rule}")

    def _register(
        self, source: Any, target: Any, refine: Refinements, **others: Any
    ) -> Registration:
        weights = self._own_weights()
        if weights is None:
            return super()._register(source, target, refine, **others)
        others = {"weights": self.weights, "normalize": self.normalize, **others}
        found = super()._register(source, target, refine, **others)
        return found._weighed_by(repr(weights), self.normalize)


@dataclass(frozen=True, kw_only=True, repr=False)
class CFK(CF):
    """The full connection of keypoints: as CF, with n^2 pairs instead of N^2.

    detector : "sift", "iss", or one with its settings, {"sift": {"octaves": 3}}, see
        `cfreg.keypoints`
    """

    name: ClassVar[str] = "cfk"
    detector: str | Mapping[str, Any] = "sift"


@dataclass(frozen=True, kw_only=True, repr=False)
class CFSpectral(FeatureMethod):
    """The strongest connections of the dual softmax, weighted to the second order, solved once.

    One step for scans that overlap in part: a connection counts as far as the connections that are
    compatible with it do. Two are compatible if they keep their length, and their normals their
    angle. No hypotheses, no sampling, no iteration over poses.

    voxel : size of the voxels that both clouds are thinned to, and the unit of all lengths. None:
        such that the larger cloud keeps some 3000 points; all of them where neither has more
    weights : kernel of the squared distance of descriptors, by its name, see CF
    beta : squared bandwidth, 1e-12 to 1e12, "auto" or "auto:SHARE"
    connections : how many are kept, 3 to 10,000. Time grows with the square
    compatibility : numbers by name. length_tolerance (1.5) and min_length (2), in voxel sizes: the
        largest difference of two lengths, and the least length; normal_tolerance (0.5): the largest
        difference of the cosines of normals, 2 to compare none
    solver : "arun", "horn-quaternion", "horn-matrix", "walker"; all give the same answer
    prior : cfreg.Prior, what is known of the pose beforehand
    neighbors, radius, normal_neighbors, more_neighbors, orientation, histogram,
        channels, given_descriptors : see CF; by default 100 neighbours, normals of 20, "open3d"

    >>> import cfreg
    >>> cfreg.CFSpectral(compatibility={"min_length": 3}).settings()["compatibility"]["min_length"]
    3.0
    """

    name: ClassVar[str] = "cf-spectral"
    neighbors: int = 100
    normal_neighbors: int | None = 20
    histogram: str = "open3d"
    voxel: float | None = None
    weights: str = "gaussian"
    beta: float | str = "auto"
    connections: int = 2000
    compatibility: Mapping[str, float] | None = None
    solver: str = "arun"
    prior: Prior | None = None
    threads: int = 0


@dataclass(frozen=True, kw_only=True, repr=False)
class TEASER(FeatureMethod):
    """Matches of descriptors, the largest consistent set of them, truncated least squares.

    cross_check : whether matches must be the best both ways
    noise_bound : how far a right match may be off, in the unit of the clouds. None: four
        resolutions of the coarser cloud
    estimate_scale : whether the clouds may differ in scale
    gnc_factor, cost_threshold, max_iterations : of the graduated non-convexity
    clique_steps : most steps of the search for the largest consistent set
    certify : whether to bound how far the rotation is from the best
    prior : cfreg.Prior, what is known of the pose beforehand
    trace : whether to record every iteration
    neighbors, radius, normal_neighbors, more_neighbors, orientation, histogram,
        channels, given_descriptors : see CF
    """

    name: ClassVar[str] = "teaser"
    cross_check: bool = True
    noise_bound: float | None = None
    estimate_scale: bool = False
    gnc_factor: float = 1.4
    cost_threshold: float = 0.005
    max_iterations: int = 1000
    clique_steps: int = 5_000_000
    certify: bool = False
    prior: Prior | None = None
    trace: bool = False
    threads: int = 0

    def register(
        self,
        source: Any,
        target: Any,
        *,
        matches: npt.ArrayLike | None = None,
        refine: Refinements = (),
        verdict: bool | str = "auto",
        keep_no_returns: bool = False,
    ) -> Registration:
        """As Method.register.

        matches : (K, 2) integers, a row of the source and one of the target each, right or
            wrong, instead of those by descriptors. The clouds must then be finite
        """
        return self._register(
            source, target, refine, verdict=verdict, keep_no_returns=keep_no_returns, matches=matches
        )


def _named(kernel: Kernel) -> dict[str, Any] | None:
    """Name and bandwidth of a kernel of the catalogue."""
    spec: dict[str, Any] | None = kernel._spec()
    return spec if spec is not None and "kernel" in spec else None
