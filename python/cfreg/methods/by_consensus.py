"""The method for clouds of which nothing is known."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from .. import _interop, _native
from ..prior import Prior
from ..results import Verdict
from .base import Method

if TYPE_CHECKING:
    import numpy.typing as npt


@dataclass(frozen=True, kw_only=True, repr=False)
class Consensus(Method):
    """Scans that overlap in part: matches that agree with each other, verified on the surfaces.

    Its results have a `verdict`: how probable the pose is, why, and what else it might be.

    voxel : the length that all others follow from, in the unit of the clouds, which are
        thinned to one point per cube of this side. None: such that 5000 points are left of
        the cloud where it is longer
    seeds : matches from which a pose is sought, at least 1; more find smaller overlaps
    prior : cfreg.Prior, what is known of the pose beforehand
    channels : names of channels of both clouds to compare points by too, "intensity:0.5" with
        a share: 1, the default, matters as much as the whole shape
    given_descriptors : use of the descriptors that both clouds carry (`PointCloud(descriptors=...)`,
        or `descriptors` of register): "replace" FPFH, or "beside" it; with ":cosine" by the angle
        between rows. None: they are not used
    range_limit : whether returns at the limit of a sensor's range are looked for and left out;
        False where a round wall is taken for such (the reasons of the verdict tell)
    keep_no_returns : whether rows that mark measurements without a return are kept
    model : the model that ranks poses and gives the verdict, as a file of JSON or its content; None
        for the built-in one, `src/verify/model.json`

    >>> import cfreg
    >>> cfreg.Consensus().voxel is None
    True
    """

    name: ClassVar[str] = "consensus"
    voxel: float | None = None
    seeds: int = 200
    prior: Prior | None = None
    channels: str | Sequence[str] = ()
    given_descriptors: str | None = None
    range_limit: bool = True
    keep_no_returns: bool = False
    model: str | os.PathLike[str] | dict[str, Any] | None = None
    threads: int = 0

    def __post_init__(self) -> None:
        if isinstance(self.channels, list):  # tuples compare, and cannot be changed later
            object.__setattr__(self, "channels", tuple(self.channels))
        super().__post_init__()

    def _given(self) -> dict[str, Any]:
        given = super()._given()
        if isinstance(self.model, (str, os.PathLike)):
            with open(self.model, encoding="utf-8") as file:
                try:
                    given["model"] = json.load(file)
                except ValueError as error:
                    rule = f"the file is not JSON: {error}"
                    raise _native.SettingError(f"model = {os.fspath(self.model)}: {rule}") from None
        return given

    def verify(self, source: Any, target: Any, transform: npt.ArrayLike) -> Verdict:
        """Whether a pose is right, whoever found it.

        Searches as `register` does, and looks at the pose beside what is found: another one that
        is more probable is the `runner_up`. A pose is as good as the one that it settles on, if
        that is the same to within a length; the reasons say how far away that is. Clouds that
        differ in scale by some percent are ambiguous, and the reasons name the scale.

        source, target : as for `register`
        transform : (4, 4), maps source points into the frame of the target; or a Registration

        Raises RegistrationError as `register` does, SettingError for what is no rigid matrix.
        """
        told = _native.judge(source, target, transform, self._named()[1])
        return Verdict._of(json.loads(told))


def verify(source: Any, target: Any, transform: npt.ArrayLike, **settings: Any) -> Verdict:
    """Whether a pose is right, whoever found it: `Consensus(**settings).verify`.

    >>> import cfreg, numpy as np
    >>> x, y = np.random.default_rng(0).uniform(-1, 1, (2, 1000))
    >>> cloud = np.column_stack([x, y, 0.4 * np.sin(3 * x + y) + 0.2 * x * x - 2])
    >>> cfreg.verify(cloud, cloud + [3, 4, 5], np.eye(4)).decision
    'reject'
    """
    fields = [field.name for field in dataclasses.fields(Consensus)]
    for name, value in settings.items():
        if name not in fields:
            rule = f"poses are verified by consensus, which has no such setting; it has {', '.join(fields)}"
            raise _native.SettingError(f"{name} = {_interop.shown(value)}: {rule}")
    return Consensus(**settings).verify(source, target, transform)
