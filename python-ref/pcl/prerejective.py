"""A pair by PCL's prerejective sample consensus (`prerejective.cpp`)."""

import subprocess
import tempfile
from pathlib import Path

import numpy as np

from pcl.programs import program


def align(source, target, sensors, size):
    """Pose (4, 4) from source to target, or None where too few points would meet; whether there is
    one; the seconds that it took, without files and the start of the program."""
    with tempfile.TemporaryDirectory() as folder:
        names = [Path(folder) / side for side in ("source", "target")]
        for name, points in zip(names, (source, target)):
            np.savetxt(name, points, fmt="%.9g")
        numbers = [repr(float(number)) for number in (size, *sensors[0], *sensors[1])]
        command = [program("prerejective"), *names, *numbers]
        told = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    seconds, *entries = map(float, told.split())
    pose = np.reshape(entries, (4, 4)) if entries else None
    return pose, pose is not None, seconds
