"""What methods have in common."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Union

import numpy as np

from .. import _interop, _native
from ..prior import Prior
from ..results import Registration

if TYPE_CHECKING:
    import numpy.typing as npt

Refinements = Union[None, str, "Method", Sequence[Union[str, "Method"]]]
"""Methods that start from a pose, by name or made."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Method:
    """What all methods have."""

    name: ClassVar[str]

    def __post_init__(self) -> None:
        self.settings()

    def register(
        self,
        source: Any,
        target: Any,
        *,
        refine: Refinements = (),
        verdict: bool | str = "auto",
        keep_no_returns: bool = False,
    ) -> Registration:
        """Find the pose of the source in the frame of the target.

        source, target : PointCloud, (N, 3) numbers, or whatever else PointCloud takes, or the path
            of a file, in the same unit
        refine : methods that start from a pose, by name or made, one after the other
        verdict : whether a pose of a method without a verdict of its own is verified by a search
            like that of Consensus: True ("on"), False ("off") or "auto", which is True here
        keep_no_returns : keep rows that mark measurements without a return, 20 or more at exactly
            one place, mostly (0, 0, 0)

        Raises RegistrationError where the clouds do not determine an answer; an answer that
        has warnings is no error, but has `trusted` False and its `doubts`.
        """
        return self._register(
            source, target, refine, verdict=verdict, keep_no_returns=keep_no_returns
        )

    def settings(self) -> dict[str, Any]:
        """Every setting by its name in the `config` of a result, and in the command line's:
        `neighbors` and `radius` are `neighborhood` there, `normal_neighbors`
        `normal_neighborhood`, `more_neighbors` `more_scales`, `normalize` `normalization`,
        `detector` `keypoints`."""
        settings: dict[str, Any] = json.loads(_native.settings(*self._named()))
        return settings

    def _named(self) -> tuple[str, str]:
        """Name, and the settings that differ from None as JSON."""
        given = self._given()
        return self.name, _interop.to_json({k: v for k, v in given.items() if v is not None})

    def _given(self) -> dict[str, Any]:
        given = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        prior = given.get("prior")
        if isinstance(prior, Prior):
            given["prior"] = prior._facts()
        return given

    def _register(
        self,
        source: Any,
        target: Any,
        refine: Refinements,
        *,
        verdict: bool | str = "auto",
        keep_no_returns: bool = False,
        **others: Any,
    ) -> Registration:
        options = _interop.to_json(_options(verdict, keep_no_returns))
        found = _native.register(
            source, target, self._named(), _refinements(refine), options, **others
        )
        return Registration(json.loads(found), (source, target))

    def __repr__(self) -> str:
        """Only what differs from the defaults."""
        fields = ((field, getattr(self, field.name)) for field in dataclasses.fields(self))
        given = [f"{field.name}={value!r}" for field, value in fields if value != field.default]
        return f"{type(self).__name__}({', '.join(given)})"


def _options(verdict: bool | str, keep_no_returns: bool) -> dict[str, Any]:
    """Whether poses are verified, and what is left out before."""
    if isinstance(verdict, (bool, np.bool_)):
        verdict = "on" if verdict else "off"
    return {"verdict": str(verdict), "keep_no_returns": bool(keep_no_returns)}


def _is_place(given: Any) -> bool:
    """Three of something."""
    try:
        return bool(np.shape(given) == (3,))
    except ValueError:  # rows that differ in length
        return False


def _refinements(refine: Refinements) -> list[tuple[str, str]]:
    """Names and settings of all of them."""
    if refine is None:
        refine = ()
    if isinstance(refine, (str, Method)) or not isinstance(refine, Sequence):
        refine = [refine]
    if isinstance(refine, memoryview):  # a sequence, too
        raise TypeError(f"refine: a method or its name is needed, not {_interop.shown(refine)}")
    return [_refinement(one) for one in refine]


def _refinement(given: Any) -> tuple[str, str]:
    """Name and settings of a method, given one or its name."""
    if isinstance(given, str):
        return given, "{}"
    if not isinstance(given, Method):
        raise TypeError(f"refine: a method or its name is needed, not {_interop.shown(given)}")
    return given._named()


@dataclass(frozen=True, kw_only=True, repr=False)
class LocalMethod(Method):
    """A method that starts from a pose."""

    def register(
        self,
        source: Any,
        target: Any,
        *,
        initial: npt.ArrayLike | None = None,
        refine: Refinements = (),
        verdict: bool | str = "auto",
        keep_no_returns: bool = False,
    ) -> Registration:
        """As Method.register.

        initial : (4, 4) pose to start from. None: the pose in which the clouds lie. Pairs of ICP
            without a max_distance are then as long as that pose may be off, and shrink with it
        """
        return self._register(
            source, target, refine, verdict=verdict, keep_no_returns=keep_no_returns, initial=initial
        )


@dataclass(frozen=True, kw_only=True, repr=False)
class FeatureMethod(Method):
    """A method that describes points by FPFH.

    neighbors : nearest points of a neighbourhood, the point itself counted, at least 3
    radius : all points within this radius instead, in the unit of the clouds
    normal_neighbors : nearest points for normals. None: as for descriptors
    more_neighbors : more scales whose descriptors are put beside, each by its nearest points,
        200, or by those for its normals too, "200:50"
    orientation : where normals point: "viewpoint" (the cloud's, or else the origin),
        "outward", "stored" (those of the clouds), or three numbers to look towards
    histogram : "pcl", blocks that sum to 100, or "open3d", blocks that sum to 200
    channels : names of channels of both clouds to compare points by too, "intensity:0.5" with
        a share: 1, the default, matters as much as the whole shape
    given_descriptors : use of the descriptors that both clouds carry (`PointCloud(descriptors=...)`,
        or `descriptors` of register): "replace" FPFH, or "beside" it; with ":cosine" by the angle
        between rows. None: they are not used
    """

    neighbors: int = 150
    radius: float | None = None
    normal_neighbors: int | None = None
    more_neighbors: Sequence[int | str] = ()
    orientation: str | Sequence[float] = "viewpoint"
    histogram: str = "pcl"
    channels: str | Sequence[str] = ()
    given_descriptors: str | None = None

    def __post_init__(self) -> None:
        # Tuples compare, and cannot be changed later.
        for name in ("more_neighbors", "orientation", "channels"):
            value = getattr(self, name)
            if isinstance(value, (list, np.ndarray)):
                object.__setattr__(self, name, tuple(value if isinstance(value, list) else value.tolist()))
        if not isinstance(self.orientation, str) and not _is_place(self.orientation):
            rule = "must be viewpoint, outward, stored or three numbers"
            given = _interop.shown(self.orientation)
            raise _native.SettingError(f"orientation = {given}: {rule}")
        super().__post_init__()

    def _given(self) -> dict[str, Any]:
        given = super()._given()
        if self.radius is not None:
            if given.pop("neighbors") != type(self).neighbors:
                rule = "radius takes its place: leave one of them out"
                given_too = _interop.shown(self.neighbors)
                raise _native.SettingError(f"neighbors = {given_too}: {rule}")
        if not isinstance(self.orientation, str):
            given["viewpoint"] = given.pop("orientation")
        return given
