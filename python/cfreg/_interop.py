"""What is known of other libraries: by the attributes of their objects, without importing them.

`parts` takes a cloud of any of them apart, `moved` moves one, the `to_...` make one.
"""

from __future__ import annotations

import copy
import json
import math
from importlib import import_module
from typing import Any

import numpy as np

from ._native import Error, PointCloud, ShapeError


def parts(cloud: Any, name: str) -> tuple[Any, Any]:
    """Points (N, 3) and normals (N, 3), or None, of whatever stands for a cloud; `name` is
    what an error calls it."""
    if isinstance(cloud, np.ndarray) or hasattr(cloud, "__dataframe__"):
        # Of data frames the columns are attributes, under any name.
        return array(cloud, name), None
    tensors = _tensors(cloud)
    if tensors is not None:
        if "positions" not in tensors:
            return np.zeros((0, 3), np.float32), None
        normals = array(tensors["normals"], name) if "normals" in tensors else None
        return array(tensors["positions"], name), normals
    if hasattr(cloud, "has_normals") and hasattr(cloud, "points"):  # Open3D
        return np.asarray(cloud.points), _some(cloud.normals)
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
        f"trimesh, pyvista or small_gicp, not {type(cloud).__name__}"
    )


def colors(cloud: Any) -> Any:
    """Colours (N, 3) from 0 to 1 of a cloud of Open3D; None for others, and without any."""
    if hasattr(cloud, "has_normals") and hasattr(cloud, "colors") and hasattr(cloud, "points"):
        return _some(cloud.colors)
    tensors = _tensors(cloud)
    if tensors is None or "colors" not in tensors or "positions" not in tensors:
        return None
    found = array(tensors["colors"], "colors")
    whole = np.iinfo(found.dtype).max if found.dtype.kind == "u" else 1.0
    return found / whole


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
    """`cloud`, of whatever kind, moved by a (4, 4) matrix: the same kind again, but an array
    for what only stands for one."""
    if isinstance(cloud, PointCloud):
        return cloud.transformed(transform)
    if _tensors(cloud) is not None:
        return cloud.clone().transform(transform)
    if hasattr(cloud, "get_geometry_type"):  # Open3D
        return copy.deepcopy(cloud).transform(transform)
    if hasattr(cloud, "point_data"):  # pyvista
        return cloud.transform(transform, inplace=False)
    if hasattr(cloud, "apply_transform"):  # trimesh
        return cloud.copy().apply_transform(transform)
    points, _ = parts(cloud, "cloud")
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"cloud: expected shape (N, 3), found {points.shape}")
    rows = points @ transform[:3, :3].T + transform[:3, 3]
    if callable(getattr(cloud, "points", None)):  # small_gicp
        return type(cloud)(rows)
    return rows.astype(points.dtype) if points.dtype.kind == "f" else rows


def to_open3d(cloud: Any) -> Any:
    open3d = import_module("open3d")

    made = open3d.geometry.PointCloud()
    made.points = open3d.utility.Vector3dVector(np.asarray(cloud.points, dtype=np.float64))
    if cloud.normals is not None:
        made.normals = open3d.utility.Vector3dVector(cloud.normals.astype(np.float64))
    channels = cloud.channels
    if all(name in channels for name in ("red", "green", "blue")):
        rows = np.column_stack([channels[name] for name in ("red", "green", "blue")])
        made.colors = open3d.utility.Vector3dVector(rows.astype(np.float64))
    return made


def to_trimesh(cloud: Any) -> Any:
    trimesh = import_module("trimesh")

    return trimesh.PointCloud(np.array(cloud.points))


def to_pyvista(cloud: Any) -> Any:
    pyvista = import_module("pyvista")

    made = pyvista.PolyData(np.array(cloud.points))
    if cloud.normals is not None:
        made.point_data["Normals"] = cloud.normals
    return made


def to_small_gicp(cloud: Any) -> Any:
    small_gicp = import_module("small_gicp")

    return small_gicp.PointCloud(np.asarray(cloud.points, dtype=np.float64))


def to_json(settings: dict[str, Any]) -> str:
    """Settings as JSON; NaN and infinity, which JSON does not know, as words, which every
    setting refuses."""
    return json.dumps({name: _plain(name, value) for name, value in settings.items()})


def _plain(name: str, value: Any) -> Any:
    if isinstance(value, np.generic) or isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
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
