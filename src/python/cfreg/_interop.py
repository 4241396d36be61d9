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


def parts(cloud: Any, name: str) -> tuple[Any, Any]:
    """Points (N, 3) and normals (N, 3), or None, of whatever stands for a cloud; `name` is
    what an error calls it."""
    if _is_tensor_cloud(cloud):
        tensors = cloud.point
        normals = tensors["normals"].cpu().numpy() if "normals" in tensors else None
        return tensors["positions"].cpu().numpy(), normals
    if hasattr(cloud, "has_normals") and hasattr(cloud, "points"):  # Open3D
        normals = np.asarray(cloud.normals) if cloud.has_normals() else None
        return np.asarray(cloud.points), normals
    if hasattr(cloud, "point_data"):  # pyvista
        stored = cloud.point_data
        normals = np.asarray(stored["Normals"]) if "Normals" in stored else None
        return np.asarray(cloud.points), normals
    if hasattr(cloud, "vertices"):  # trimesh; only meshes have normals
        normals = getattr(cloud, "vertex_normals", None)
        return np.asarray(cloud.vertices), None if normals is None else np.asarray(normals)
    if callable(getattr(cloud, "points", None)):  # small_gicp: homogeneous, and its normals
        return np.asarray(cloud.points())[:, :3], None  # are not defined until estimated
    if isinstance(cloud, np.ndarray) or hasattr(cloud, "__array__"):
        return array(cloud, name), getattr(cloud, "normals", None)
    raise TypeError(
        f"{name} must be a numpy array (N, 3) of float32 or float64, or a point cloud of cfreg, "
        f"Open3D, trimesh, pyvista or small_gicp, not {type(cloud).__name__}"
    )


def array(values: Any, name: str) -> Any:
    """A plain array for what is one in disguise; masked values become NaN."""
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind == "f":
        return values.filled(np.nan)
    if isinstance(values, np.ndarray) or hasattr(values, "__array__"):
        return np.asarray(values)
    raise TypeError(
        f"{name} must be a numpy array, not {type(values).__name__}: convert with numpy.asarray"
    )


def weights(found: Any) -> Any:
    """A plain array of what a weight function returned; masked connections have no weight."""
    return found.filled(0) if isinstance(found, np.ma.MaskedArray) else np.asarray(found)


def moved(cloud: Any, transform: Any) -> Any:
    """`cloud`, of whatever kind, moved by a (4, 4) matrix: the same kind again."""
    from ._native import PointCloud, ShapeError

    if isinstance(cloud, PointCloud):
        return cloud.transformed(transform)
    if _is_tensor_cloud(cloud):
        return cloud.clone().transform(transform)
    if hasattr(cloud, "has_normals") and hasattr(cloud, "transform"):  # Open3D
        return copy.deepcopy(cloud).transform(transform)
    if hasattr(cloud, "point_data"):  # pyvista
        return cloud.transform(transform, inplace=False)
    if hasattr(cloud, "apply_transform"):  # trimesh
        return cloud.copy().apply_transform(transform)
    points, _ = parts(cloud, "cloud")
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"cloud: expected shape (N, 3), found {points.shape}")
    rows = points @ transform[:3, :3].T + transform[:3, 3]
    if isinstance(cloud, np.ndarray):
        return rows.astype(points.dtype) if points.dtype.kind == "f" else rows
    return type(cloud)(rows)  # small_gicp


def to_open3d(cloud: Any) -> Any:
    open3d = import_module("open3d")

    made = open3d.geometry.PointCloud()
    made.points = open3d.utility.Vector3dVector(np.asarray(cloud.points, dtype=np.float64))
    if cloud.normals is not None:
        made.normals = open3d.utility.Vector3dVector(cloud.normals.astype(np.float64))
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


def _is_tensor_cloud(cloud: Any) -> bool:
    """Whether it is a cloud of open3d.t."""
    return hasattr(cloud, "point") and not callable(cloud.point) and "positions" in cloud.point
