"""What is known of other libraries: by the attributes of their objects, without importing them.

`parts` and `attributes` take a cloud of any of them apart, `moved` moves one, the `to_...` make one;
`shown` is how messages show a value.
"""

from __future__ import annotations

import copy
import json
import math
import os
import reprlib
import tempfile
from importlib import import_module
from typing import Any

import numpy as np

from ._native import Error, PointCloud, ShapeError, read, write


def parts(cloud: Any, name: str) -> tuple[Any, Any]:
    """Points (N, 3) and normals (N, 3), or None, of whatever stands for a cloud; `name` is
    what an error calls it."""
    if _is_table(cloud):
        return array(cloud, name), None
    if isinstance(cloud, (bytes, bytearray)):
        raise Error(f"{name} must be a cloud, not bytes: of a path in bytes give os.fsdecode(path)")
    tensors = _tensors(cloud)
    if tensors is not None:
        if "positions" not in tensors:
            return np.zeros((0, 3), np.float32), None
        normals = array(tensors["normals"], name) if "normals" in tensors else None
        return array(tensors["positions"], name), normals
    if hasattr(cloud, "has_normals") and hasattr(cloud, "points"):  # Open3D
        return np.asarray(cloud.points), _some(cloud.normals)
    if hasattr(cloud, "point_format") and hasattr(cloud, "xyz"):  # laspy
        return np.asarray(cloud.xyz), None
    if hasattr(cloud, "point_data"):  # pyvista
        stored = cloud.point_data
        normals = np.asarray(stored["Normals"]) if "Normals" in stored else None
        return np.asarray(cloud.points), normals
    if hasattr(cloud, "vertices"):  # trimesh and meshes of Open3D
        return np.asarray(cloud.vertices), _some(getattr(cloud, "vertex_normals", None))
    if callable(getattr(cloud, "points", None)):  # small_gicp: homogeneous, and its normals
        return np.asarray(cloud.points())[:, :3], None  # are not defined until estimated
    if _is_array(cloud) or isinstance(cloud, (list, tuple)):
        return array(cloud, name), getattr(cloud, "normals", None)
    raise Error(
        f"{name} must be an array or rows of numbers (N, 3), or a point cloud of cfreg, Open3D, "
        f"trimesh, pyvista, laspy or small_gicp, not {type(cloud).__name__}"
    )


def attributes(cloud: Any) -> tuple[Any, dict[str, Any]]:
    """Weights (N,), or None, and channels {name: (N,)} of a cloud of another library. Colours are red,
    green and blue from 0 to 1."""
    if _is_table(cloud) or isinstance(cloud, (list, tuple)):
        return None, {}
    columns: dict[str, Any] = {}
    colors, stored = _colors_and_columns(cloud)
    if colors is not None:
        colors = np.asarray(colors)
        whole = np.iinfo(colors.dtype).max if colors.dtype.kind == "u" else 1.0
        columns.update(zip(_COLORS, (colors[:, :3] / whole).T))
    for name, values in stored.items():
        values = np.asarray(values)
        if values.ndim == 2 and values.shape[1] == 1:
            values = values[:, 0]
        if name not in columns and values.ndim == 1 and values.dtype.kind in "biuf":
            columns[name] = values
    return columns.pop("weight", None), columns


_COLORS = ("red", "green", "blue")


def _colors_and_columns(cloud: Any) -> tuple[Any, dict[str, Any]]:
    """Colours (N, 3 or 4), or None, and the other columns that a cloud has by their names."""
    tensors = _tensors(cloud)
    if tensors is not None:
        if "positions" not in tensors:
            return None, {}
        columns = {str(name): array(tensors[name], str(name)) for name in tensors}
        return columns.pop("colors", None), columns
    if hasattr(cloud, "has_normals") and hasattr(cloud, "points"):  # Open3D
        return _some(getattr(cloud, "colors", None)), {}
    if hasattr(cloud, "point_format") and hasattr(cloud, "xyz"):  # laspy
        return None, _las_columns(cloud)
    if hasattr(cloud, "point_data"):  # pyvista
        columns = {str(name): np.asarray(values) for name, values in cloud.point_data.items()}
        colors = None
        for name in ("RGB", "RGBA"):  # as VTK's readers call them
            found = columns.get(name)
            if found is not None and found.ndim == 2 and found.shape[1] in (3, 4):
                colors = columns.pop(name)
        return colors, columns
    if getattr(getattr(cloud, "visual", None), "kind", None) == "vertex":  # trimesh
        return _some(cloud.visual.vertex_colors), {}
    return _some(getattr(cloud, "vertex_colors", None)), {}  # meshes of Open3D


def _las_columns(cloud: Any) -> dict[str, Any]:
    """The dimensions of a cloud of laspy that are not 0 everywhere; colours from 0 to 1."""
    columns = {}
    for name in cloud.point_format.dimension_names:
        values = np.asarray(cloud[name])
        if name not in ("X", "Y", "Z") and values.ndim == 1 and values.any():
            columns[name] = values
    if all(name in columns for name in _COLORS):
        whole = 255 if max(columns[name].max() for name in _COLORS) <= 255 else 65535
        columns.update({name: columns[name] / whole for name in _COLORS})
    return columns


def array(values: Any, name: str) -> Any:
    """A plain array for lists, and for what is one in disguise; masked values become NaN."""
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "iuf":
        floats: Any = values.astype(np.result_type(values.dtype, np.float32))
        return floats.filled(np.nan)
    if isinstance(values, (list, tuple)):
        try:
            return np.asarray(values)
        except ValueError as error:
            raise ShapeError(f"{name}: rows differ in length") from error
    if not _is_array(values):
        raise Error(f"{name} must be an array or a list of numbers, not {type(values).__name__}")
    for step in ("detach", "cpu", "numpy"):  # tensors
        if hasattr(values, step):
            values = getattr(values, step)()
    return np.asarray(values)


def normals(given: Any) -> Any:
    """An array of normals; of all that estimate_normals returned, its normals."""
    if isinstance(given, tuple) and [getattr(part, "ndim", None) for part in given] == [2, 1]:
        given = given[0]
    return array(given, "normals")


class _Shown(reprlib.Repr):
    """Values as messages have them: a line at most."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother, self.maxlong = 3, 60, 60, 40
        self.maxlist = self.maxtuple = self.maxset = self.maxfrozenset = self.maxdict = 4

    def repr1(self, x: Any, level: int) -> str:
        if isinstance(x, np.ndarray) and x.ndim > 0:
            return _array_shown(x)
        if isinstance(x, np.generic):
            x = x.item()
        if hasattr(x, "shape") and not isinstance(x, type):  # tensors and data frames
            return f"{type(x).__name__} of shape {tuple(x.shape)}"
        return super().repr1(x, level)


def _array_shown(values: Any) -> str:
    first = [_SHOWN.repr1(value, 1) for value in values.flat[:3]]
    more = ", ..." if values.size > 3 else ""
    return f"array of {values.dtype.name} with shape {values.shape} [{', '.join(first)}{more}]"


_SHOWN = _Shown()


def shown(value: Any) -> str:
    """A value of the user's as messages have it: of arrays and lists the first few numbers, of texts the
    ends."""
    try:
        text = _SHOWN.repr(value)
    except Exception:
        text = f"a {type(value).__name__}"
    return ends(text)


def ends(text: str) -> str:
    """A text, or its ends where it is long."""
    return text if len(text) <= 200 else text[:140] + " ... " + text[-50:]


def _is_table(cloud: Any) -> bool:
    """An array of numpy's, or a data frame, whose columns are attributes under any name."""
    return isinstance(cloud, np.ndarray) or hasattr(cloud, "__dataframe__")


def _is_array(values: Any) -> bool:
    """Whether it is an array of numpy's, a tensor, or lies in memory as an array does."""
    if hasattr(values, "__array__") or (hasattr(values, "cpu") and hasattr(values, "numpy")):
        return True
    try:
        memoryview(values)
    except TypeError:
        return False
    return True


def _some(normals: Any) -> Any:
    """Normals as an array, or None where there are none."""
    normals = None if normals is None else np.asarray(normals)
    return None if normals is None or len(normals) == 0 else normals


def weights(found: Any) -> Any:
    """A plain array of what a weight function returned; masked connections have no weight."""
    return found.filled(0) if isinstance(found, np.ma.MaskedArray) else np.asarray(found)


def moved(cloud: Any, transform: Any) -> Any:
    """`cloud`, of whatever kind, moved by a (4, 4) matrix: the same kind again, but a PointCloud for
    a path, and an array for what only stands for one."""
    if isinstance(cloud, (str, os.PathLike)):
        cloud = read(cloud)
    if isinstance(cloud, PointCloud):
        return cloud.transformed(transform)
    transform = np.array(transform)  # libraries may need to write
    if _tensors(cloud) is not None:
        return cloud.clone().transform(transform)
    if hasattr(cloud, "get_geometry_type"):  # Open3D
        return copy.deepcopy(cloud).transform(transform)
    if hasattr(cloud, "point_data"):  # pyvista
        return _moved_by_vtk(cloud, transform)
    if hasattr(cloud, "apply_transform"):  # trimesh
        return cloud.copy().apply_transform(transform)
    points, _ = parts(cloud, "cloud")
    if points.dtype.kind not in "iuf":
        raise Error(f"cloud must be numbers, not {points.dtype}")
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"cloud: expected shape (N, 3), found {points.shape}")
    rows = points @ transform[:3, :3].T + transform[:3, 3]
    if callable(getattr(cloud, "points", None)):  # small_gicp
        return type(cloud)(rows)
    return rows.astype(points.dtype) if points.dtype.kind == "f" else rows


def _moved_by_vtk(cloud: Any, transform: Any) -> Any:
    """A mesh of pyvista, moved: VTK turns the normals that it takes for active alone."""
    made = cloud.transform(transform, inplace=False)
    if "Normals" in cloud.point_data and cloud.point_data.active_normals_name != "Normals":
        rotation = transform[:3, :3] / np.cbrt(np.linalg.det(transform[:3, :3]))
        normals = np.array(cloud.point_data["Normals"])
        made.point_data["Normals"] = (normals @ rotation.T).astype(normals.dtype)
    return made


# The arrays of a PointCloud are read-only and shared: others are given copies of their own.


def to_open3d(cloud: Any) -> Any:
    open3d = import_module("open3d")

    made = open3d.geometry.PointCloud()
    made.points = open3d.utility.Vector3dVector(np.array(cloud.points, dtype=np.float64))
    if cloud.normals is not None:
        made.normals = open3d.utility.Vector3dVector(np.array(cloud.normals, dtype=np.float64))
    colors = _colors(cloud)
    if colors is not None:
        made.colors = open3d.utility.Vector3dVector(colors.astype(np.float64))
    return made


def to_trimesh(cloud: Any) -> Any:
    trimesh = import_module("trimesh")

    colors = _colors(cloud)
    if colors is not None:
        colors = _bytes(colors)
    return trimesh.PointCloud(np.array(cloud.points), colors=colors)


def to_pyvista(cloud: Any) -> Any:
    pyvista = import_module("pyvista")

    made = pyvista.PolyData(np.array(cloud.points))
    columns = {name: np.array(values) for name, values in cloud.channels.items()}
    colors = _colors(cloud)
    if colors is not None:
        for name in _COLORS:
            del columns[name]
        rounded = _bytes(colors)
        # VTK's own way, unless that would round.
        columns["RGB"] = rounded if np.allclose(rounded / 255, colors, rtol=0, atol=1e-6) else colors
    if cloud.weights is not None:
        columns["weight"] = np.array(cloud.weights)
    if cloud.normals is not None:
        columns["Normals"] = np.array(cloud.normals)
    for name, values in columns.items():
        made.point_data[name] = values
    if cloud.normals is not None:
        made.point_data.active_normals_name = "Normals"
    return made


def to_laspy(cloud: Any) -> Any:
    laspy = import_module("laspy")

    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "cloud.las")
        write(path, cloud)
        return laspy.read(path)


def to_small_gicp(cloud: Any) -> Any:
    small_gicp = import_module("small_gicp")

    return small_gicp.PointCloud(np.array(cloud.points, dtype=np.float64))


def _colors(cloud: PointCloud) -> Any:
    """Colours (N, 3) float32 of a PointCloud, or None where it has none from 0 to 1."""
    channels = cloud.channels
    if not all(name in channels for name in _COLORS):
        return None
    colors = np.column_stack([channels[name] for name in _COLORS])
    return colors if bool(np.all((colors >= 0.0) & (colors <= 1.0))) else None


def _bytes(colors: Any) -> Any:
    return np.rint(255 * colors).astype(np.uint8)


def to_json(settings: dict[str, Any]) -> str:
    """Settings as JSON; NaN and infinity, which JSON does not know, as words, which every
    setting refuses."""
    return json.dumps({name: _plain(name, value) for name, value in settings.items()})


def _plain(name: str, value: Any) -> Any:
    if isinstance(value, np.generic) or isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, int) and abs(value) >= 1 << 64:  # no number of JSON's
        return f"a whole number of {value.bit_length()} bits"
    if isinstance(value, dict):
        return {str(key): _plain(name, part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(name, part) for part in value]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{name}: {type(value).__name__} is no kind of value that settings have")


def _tensors(cloud: Any) -> Any:
    """What a cloud or mesh of open3d.t has for every point, or None for others."""
    for name in ("point", "vertex"):
        tensors = getattr(cloud, name, None)
        if hasattr(tensors, "primary_key"):
            return tensors
    return None
