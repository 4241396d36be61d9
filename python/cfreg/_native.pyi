"""Types of the compiled part; tests compare them with it."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Final, TypeAlias, final

import numpy as np
import numpy.typing as npt

from .prior import Prior
from .weights import Kernel, Weights

__all__ = [
    "DegenerateError",
    "Error",
    "ExtentError",
    "FileFormatError",
    "InternalError",
    "Moments",
    "NoWeightError",
    "NonFiniteError",
    "PointCloud",
    "RegistrationError",
    "SettingError",
    "ShapeError",
    "TooFewPointsError",
    "__version__",
    "check_kernel",
    "consecutive",
    "estimate_normals",
    "evaluate",
    "judge",
    "fpfh",
    "is_usable",
    "keypoints",
    "kernel_weights",
    "moments",
    "moments_of_pairs",
    "read",
    "read_batch",
    "read_list",
    "register",
    "register_batch",
    "register_pose",
    "report",
    "rotation_vector",
    "settings",
    "solve",
    "thumbnail",
    "within",
    "write",
    "write_g2o",
]

__version__: Final[str]

_CloudLike: TypeAlias = Any
"""PointCloud, (N, 3) numbers, or a cloud of another library."""
_Matrix: TypeAlias = npt.ArrayLike
"""(4, 4) numbers."""
_Place: TypeAlias = Sequence[float] | npt.NDArray[Any]
"""Three numbers."""

class Error(ValueError): ...
class RegistrationError(Error): ...
class TooFewPointsError(RegistrationError): ...
class NoWeightError(RegistrationError): ...
class DegenerateError(RegistrationError): ...
class NonFiniteError(Error): ...
class ShapeError(Error): ...
class SettingError(Error): ...
class FileFormatError(Error): ...
class ExtentError(Error): ...
class InternalError(Error): ...

@final
class PointCloud:
    def __new__(
        cls,
        points: _CloudLike,
        normals: Any = None,
        viewpoint: _Place | None = None,
        weights: Any = None,
        channels: Mapping[str, Any] | None = None,
        descriptors: Any = None,
    ) -> PointCloud: ...
    @property
    def descriptors(self) -> npt.NDArray[np.float32] | None: ...
    @property
    def weights(self) -> npt.NDArray[np.float32] | None: ...
    @property
    def channels(self) -> dict[str, npt.NDArray[np.float32]]: ...
    @property
    def points(self) -> npt.NDArray[Any]: ...
    @property
    def normals(self) -> npt.NDArray[np.float32] | None: ...
    @property
    def viewpoint(self) -> npt.NDArray[np.float64] | None: ...
    @property
    def dropped(self) -> int: ...
    @property
    def no_returns(self) -> int: ...
    @property
    def bounds(self) -> npt.NDArray[np.float64] | None: ...
    @property
    def resolution(self) -> float: ...
    def voxel(self, size: float) -> PointCloud: ...
    def sample(self, count: int, seed: int = 0) -> PointCloud: ...
    def transformed(self, transform: _Matrix) -> PointCloud: ...
    def to_open3d(self) -> Any: ...
    def to_trimesh(self) -> Any: ...
    def to_pyvista(self) -> Any: ...
    def to_small_gicp(self) -> Any: ...
    def __len__(self) -> int: ...
    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]: ...
    def __eq__(self, value: object, /) -> bool: ...
    def __ne__(self, value: object, /) -> bool: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    @staticmethod
    def _from_parts(
        points: npt.NDArray[np.float32],
        origin: _Place,
        frame_origin: _Place,
        normals: npt.NDArray[np.float32] | None,
        viewpoint: _Place | None,
        left_out: tuple[int, int],
        has: tuple[
            npt.NDArray[np.float32] | None, dict[str, npt.NDArray[np.float32]], dict[str, int]
        ],
    ) -> PointCloud: ...

@final
class Moments:
    @property
    def weight(self) -> float: ...
    @property
    def weight_squared(self) -> float: ...
    @property
    def source_sum(self) -> npt.NDArray[np.float64]: ...
    @property
    def target_sum(self) -> npt.NDArray[np.float64]: ...
    @property
    def cross(self) -> npt.NDArray[np.float64]: ...
    @property
    def source_squares(self) -> float: ...
    @property
    def target_squares(self) -> float: ...
    @property
    def source_origin(self) -> npt.NDArray[np.float64]: ...
    @property
    def target_origin(self) -> npt.NDArray[np.float64]: ...
    @property
    def effective_connections(self) -> float: ...
    def residual(self, transform: _Matrix) -> float: ...
    def __eq__(self, value: object, /) -> bool: ...
    def __ne__(self, value: object, /) -> bool: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    @staticmethod
    def _from_json(json: str) -> Moments: ...

def read(path: str | PathLike[str]) -> PointCloud: ...
def write(path: str | PathLike[str], cloud: _CloudLike) -> None: ...
def estimate_normals(
    points: _CloudLike, neighbors: int = 150, viewpoint: _Place | None = None
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]: ...
def fpfh(
    points: _CloudLike,
    neighbors: int = 150,
    scale: str = "pcl",
    viewpoint: _Place | None = None,
    normals: Any = None,
) -> npt.NDArray[np.float32]: ...
def keypoints(
    points: _CloudLike, detector: str = "sift", values: Any = None, **settings: Any
) -> npt.NDArray[np.uint64]: ...
def moments(
    source_points: _CloudLike,
    target_points: _CloudLike,
    source_descriptors: Any,
    target_descriptors: Any,
    weights: str | Kernel | Weights = "gaussian",
    beta: float | str | None = None,
    normalize: str = "none",
    tolerance: float = 0.0,
    threads: int = 0,
) -> Moments: ...
def moments_of_pairs(
    source_points: _CloudLike, target_points: _CloudLike, pairs: Any, weights: Any = None
) -> Moments: ...
def solve(
    moments: Moments, solver: str = "arun", scale: str = "fixed", prior: Prior | None = None
) -> npt.NDArray[np.float64]: ...
def register(
    source: _CloudLike,
    target: _CloudLike,
    method: tuple[str, str],
    refinements: Sequence[tuple[str, str]],
    options: str,
    weights: Kernel | Weights | None = None,
    normalize: str = "none",
    initial: _Matrix | None = None,
    matches: npt.ArrayLike | None = None,
    scores: npt.ArrayLike | None = None,
    descriptors: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
) -> str: ...
def register_pose(
    source: _CloudLike,
    target: _CloudLike,
    transform: _Matrix,
    method: tuple[str, str],
    refinements: Sequence[tuple[str, str]],
    options: str,
) -> str: ...
def register_batch(
    pairs: Sequence[tuple[str, str]] | str | PathLike[str],
    clouds: dict[str, Any],
    folder: str | PathLike[str] | None,
    method: tuple[str, str],
    refinements: Sequence[tuple[str, str]],
    settings: str,
    output: str | PathLike[str] | None = None,
    progress: Callable[[int, int], object] | None = None,
    custom: Any = None,
) -> Any: ...
def read_list(path: str | PathLike[str]) -> list[tuple[str, str]]: ...
def read_batch(path: str | PathLike[str]) -> dict[str, tuple[str, Any]]: ...
def write_g2o(
    path: str | PathLike[str],
    rows: str,
    rotations: str,
    names: str | PathLike[str] | None,
) -> tuple[int, int, int, int, int]: ...
def consecutive(count: int, steps: Sequence[int]) -> list[tuple[int, int]]: ...
def within(places: Sequence[Sequence[float]], radius: float) -> list[tuple[int, int]]: ...
def settings(name: str, settings: str) -> str: ...
def evaluate(
    source: _CloudLike,
    target: _CloudLike,
    transform: _Matrix,
    max_distance: float | None = None,
    truth: _Matrix | None = None,
) -> str: ...
def is_usable(
    transform: Sequence[Sequence[float]], trusted: bool, decision: str | None = None
) -> bool: ...
def rotation_vector(matrix: npt.NDArray[np.float64]) -> tuple[list[float], float]: ...
def judge(
    source: _CloudLike, target: _CloudLike, transform: _Matrix, settings: str
) -> str: ...
def report(result: str, source: _CloudLike, target: _CloudLike) -> str: ...
def thumbnail(
    result: str, source: _CloudLike, target: _CloudLike, size: tuple[int, int]
) -> bytes: ...
def kernel_weights(
    kernel: str, squared_distances: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]: ...
def check_kernel(kernel: str) -> None: ...
