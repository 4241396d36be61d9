"""Builds the C++ programs of this folder where PCL is installed (Debian: libpcl-dev, cmake)."""

import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
BUILD = HERE.parent.parent / "target" / "pcl"


def build(name):
    """Path of the program `name`, or None where there is no CMake or no PCL."""
    if shutil.which("cmake") is None:
        return None
    configured = subprocess.run(
        ["cmake", "-S", str(HERE), "-B", str(BUILD)], capture_output=True, text=True
    )
    if configured.returncode != 0:
        if "PCLConfig.cmake" in configured.stderr:
            return None
        sys.exit(f"CMake failed:\n{configured.stderr}")
    command = ["cmake", "--build", str(BUILD), "--target", name]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return BUILD / name
