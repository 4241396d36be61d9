"""Builds the C++ programs of this folder where PCL is installed (Debian: libpcl-dev, cmake, g++)."""

import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

HERE = Path(__file__).resolve().parent
BUILD = HERE.parent.parent / "target" / "pcl"


def build(name):
    """Path of the program `name`, or None where there is no CMake, no compiler or no PCL."""
    if shutil.which("cmake") is None:
        return None
    configured = subprocess.run(
        ["cmake", "-S", str(HERE), "-B", str(BUILD)], capture_output=True, text=True
    )
    if configured.returncode != 0:
        if any(missing in configured.stderr for missing in ("PCLConfig.cmake", "CMAKE_CXX_COMPILER")):
            return None
        sys.exit(f"CMake failed:\n{configured.stderr}")
    command = ["cmake", "--build", str(BUILD), "--target", name]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return BUILD / name


@cache
def program(name):
    """The same, and None after a line that says what is left out."""
    path = build(name)
    if path is None:
        print(f"left out: PCL's {name} (libpcl-dev, cmake or g++ is not installed)")
    return path
