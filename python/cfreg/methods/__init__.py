"""The methods, each a small configuration that registers.

Every method is weights on the full connection and a closed form. `Consensus`, `CF`,
`CFSpectral`, `CFK` and `TEASER` need no start; `ICP`, `KC`, `CPD` and `DARE` start from the pose in which the clouds lie, or
from `initial`, and refine what the others found.

Settings are fields, given by name, checked when the method is made and never changed;
`dataclasses.replace` makes another method of one. What is None follows from the clouds or
from other settings. `threads` is 0 for all cores, and never changes a result.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Protocol, cast

from .. import _interop, _native
from ..results import Registration
from .base import FeatureMethod, LocalMethod, Method, Refinements, _options, _refinements
from .by_consensus import Consensus, verify
from .by_descriptor import CF, CFK, TEASER, CFSpectral
from .by_position import CPD, DARE, ICP, KC

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["CF", "CFK", "CFSpectral", "CPD", "Consensus", "DARE", "ICP", "KC", "METHODS", "Method", "TEASER", "verify", "method", "register"]

METHODS: Mapping[str, Callable[..., Method]] = {
    "consensus": Consensus,
    "cf": CF,
    "cf-multiscale": CF.multiscale,
    "cf-spectral": CFSpectral,
    "cfk": CFK,
    "teaser": TEASER,
    "icp": ICP,
    "icp-paper": ICP.paper,
    "plane-icp": ICP.plane,
    "gicp": ICP.generalized,
    "kc": KC,
    "cpd": CPD,
    "dare": DARE,
}
"""Every method by its name."""

_QUOTES = "\"'"


def method(name: str, **settings: Any) -> Method:
    """The method of that name.

    name : "consensus", "cf", "cf-multiscale", "cf-spectral", "cfk", "teaser", "icp", "icp-paper",
        "plane-icp", "gicp", "kc", "cpd" or "dare"
    settings : fields of its class

    >>> import cfreg
    >>> cfreg.method("gicp", max_distance=0.1).metric
    'generalized'
    """
    if not isinstance(name, str) or name not in METHODS:
        raise _native.SettingError(f"method = {_interop.shown(name).strip(_QUOTES)}: must be one of {', '.join(METHODS)}")
    made = METHODS[name]
    owner: Any = getattr(made, "__self__", made)  # of a preset, its class
    fields = [field.name for field in dataclasses.fields(owner)]
    for setting, value in settings.items():
        if setting not in fields:
            rule = f"{name} has no such setting; it has {', '.join(fields)}"
            raise _native.SettingError(f"{setting} = {_interop.shown(value)}: {rule}")
    return made(**settings)


class CustomMethod(Protocol):
    """A method of one's own: any object with `register(source, target)`, which returns the pose, (4, 4).

    It gets the clouds as they were given, and a PointCloud for the path of a file and for every
    cloud of register_batch; `np.asarray` makes arrays (N, 3) of either. Its result is evaluated, refined
    and verified as any other; `name` (default that of the class) and `settings` (default none), a dict of
    JSON's types, stand in the result.
    """

    def register(self, source: Any, target: Any) -> Any: ...


def _register_custom(
    chosen: CustomMethod,
    source: Any,
    target: Any,
    refine: Refinements,
    verdict: bool | str,
    keep_no_returns: bool,
) -> Registration:
    """The pose of a method of one's own, as a Registration."""
    transform = chosen.register(*(_opened(cloud) for cloud in (source, target)))
    found = _native.register_pose(
        source,
        target,
        transform,
        _custom_named(chosen),
        _refinements(refine),
        _interop.to_json(_options(verdict, keep_no_returns)),
    )
    return Registration(json.loads(found), (source, target))


def _opened(cloud: Any) -> Any:
    """The cloud of a path, or the cloud that was given."""
    return _native.read(cloud) if isinstance(cloud, (str, os.PathLike)) else cloud


def _custom_named(chosen: CustomMethod) -> tuple[str, str]:
    """Name and settings of a method of one's own."""
    name = str(getattr(chosen, "name", type(chosen).__name__))
    return name, _interop.to_json(getattr(chosen, "settings", {}))


def _is_custom(given: Any) -> bool:
    """Whether this is a method of one's own."""
    made = not isinstance(given, (str, Method, type))
    return made and callable(getattr(given, "register", None))


def _made(given: str | Method, settings: Mapping[str, Any]) -> Method:
    """A method, given one or its name."""
    if isinstance(given, str):
        return method(given, **settings)
    if not isinstance(given, Method):
        shown = f"the class {given.__name__}: make an object, {given.__name__}()" if isinstance(given, type) else _interop.shown(given)
        raise TypeError(f"method: a method or its name is needed, not {shown}")
    for setting, value in settings.items():
        rule = "the method was made already: give it there, or name the method"
        raise _native.SettingError(f"{setting} = {_interop.shown(value)}: {rule}")
    return given


def register(
    source: Any,
    target: Any,
    method: str | Method | CustomMethod = "consensus",
    *,
    refine: Refinements = (),
    initial: npt.ArrayLike | None = None,
    matches: npt.ArrayLike | None = None,
    scores: npt.ArrayLike | None = None,
    descriptors: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    verdict: bool | str = "auto",
    keep_no_returns: bool = False,
    **settings: Any,
) -> Registration:
    """Find the pose of the source in the frame of the target.

    Parameters
    ----------
    source, target : PointCloud, (N, 3) numbers in any unit, an array with any strides or a
        list of rows, a cloud of Open3D, trimesh, pyvista or small_gicp, or the path of a file.
        Rows that are not finite are left out and counted
    method : "consensus" (for scans that overlap in part), "cf" (the paper's full connection),
        "cf-multiscale" (with the sharpest weights), "cf-spectral" (one step under partial overlap), "cfk" (of keypoints), "teaser"; from the pose in which the clouds lie: "icp",
        "icp-paper", "plane-icp", "gicp", "kc", "cpd", "dare"; or a method that was made; or any
        object of your own with `register(source, target)`, which returns the pose, (4, 4)
    refine : a method that starts from a pose, by name or made, or several, one after the
        other: "gicp", ["icp", cfreg.ICP.plane(max_distance=0.1)]
    initial : (4, 4) pose to start from, for the methods that start from one
    matches : (K, 2) rows of source and target, correspondences from elsewhere, for "consensus" and
        "teaser": they take the place of those by descriptors
    scores : (K,) weights of the matches, 0 or more, for "consensus"
    descriptors : (N, D) and (M, D) numbers, D up to 512: a row for each row of source and of target,
        such as learned features, for "consensus", "cf", "cf-multiscale", "cf-spectral", "cfk" and
        "teaser". They replace FPFH, unless the setting given_descriptors has them "beside" it; with
        ":cosine", "replace:cosine", rows are compared by the angle between them
    verdict : whether a pose of a method without a verdict of its own is verified by a search like
        that of "consensus": True ("on"), False ("off") or "auto", which is True here
    keep_no_returns : keep rows that mark measurements without a return, 20 or more at exactly one
        place, mostly (0, 0, 0); `points` of the result counts those left out
    settings : of the method, by the fields of its class, which help(cfreg.CF) and its kin
        explain: of "consensus" voxel, seeds, prior, channels, range_limit; of "cf" weights, beta, normalize, tolerance, solver, scale; neighbors, radius,
        normal_neighbors, more_neighbors, orientation, histogram; threads

    Returns
    -------
    Registration : `transform` (4, 4) maps source points into the frame of the target;
        `trusted`, `doubts` and `verdict` say whether to believe it

    Raises
    ------
    RegistrationError : too few points, no connection with any weight, or clouds that do not
        determine a rotation
    SettingError : a setting that the method does not have, or out of its range
    ShapeError, Error : not (N, 3), not numbers

    Examples
    --------
    >>> import cfreg, numpy as np
    >>> x, y = np.random.default_rng(0).uniform(-1, 1, (2, 1000))
    >>> source = np.column_stack([x, y, 0.4 * np.sin(3 * x + y) + 0.2 * x * x - 2])
    >>> target = source[:, [1, 0, 2]] * [-1, 1, 1]
    >>> found = cfreg.register(source, target)
    >>> found.trusted, round(found.angle_deg), found.transform.shape
    (True, 90, (4, 4))
    """
    if _is_custom(method):
        given = {
            "initial": initial,
            "matches": matches,
            "scores": scores,
            "descriptors": descriptors,
            **settings,
        }
        for name, value in given.items():
            if value is not None:
                raise _native.SettingError(f"{name}: a method of your own takes none: give it there")
        custom = cast(CustomMethod, method)
        return _register_custom(custom, source, target, refine, verdict, keep_no_returns)
    chosen = _made(cast("str | Method", method), settings)
    others: dict[str, Any] = {}
    if initial is not None:
        if not isinstance(chosen, LocalMethod):
            raise _native.SettingError(f"initial: {chosen.name} starts from no pose: leave it out")
        others["initial"] = initial
    if matches is not None:
        if not isinstance(chosen, (TEASER, Consensus)):
            raise _native.SettingError(f"matches: {chosen.name} takes none: leave them out")
        others["matches"] = matches
    if scores is not None:
        if matches is None or not isinstance(chosen, Consensus):
            raise _native.SettingError("scores: only consensus takes them, with matches: leave them out")
        others["scores"] = scores
    if descriptors is not None:
        if not isinstance(chosen, (FeatureMethod, Consensus)):
            raise _native.SettingError(f"descriptors: {chosen.name} takes none: leave them out")
        if not isinstance(descriptors, (tuple, list)) or len(descriptors) != 2:
            shown = _interop.shown(descriptors)
            raise TypeError(f"descriptors: two arrays are needed, of source and target, not {shown}")
        if chosen.given_descriptors is None:
            chosen = dataclasses.replace(chosen, given_descriptors="replace")
        others["descriptors"] = tuple(descriptors)
    return chosen._register(
        source, target, refine, verdict=verdict, keep_no_returns=keep_no_returns, **others
    )
