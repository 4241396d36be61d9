"""The one place that runs other programs: a module each, clouds in and poses or features out.

Clouds are (N, 3) arrays, a pose is a (4, 4) array from source to target.
"""

import importlib.util
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[3]


def is_installed(package):
    """Whether Python has a package by this name."""
    return importlib.util.find_spec(package.replace("-", "_")) is not None


def left_out(name, package):
    """Whether the package is missing, after a line that says so."""
    if is_installed(package):
        return False
    print(f"left out: {name} is not installed")
    return True


def pose_from(rotation, translation):
    """(4, 4), the rotation with its scale if it has one."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, np.ravel(translation)
    return pose
