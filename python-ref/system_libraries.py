"""Open3D, or one line that says which Debian packages it lacks.

Its wheel links against libraries of a desktop, which servers and containers often
do not have; the loader's own message names one file at a time.
"""

import sys

PACKAGES = "libusb-1.0-0 libgl1 libegl1 libgomp1 libx11-6"
"""Debian 12 packages that the wheel of Open3D 0.20.0 loads."""


def import_open3d():
    """The module open3d; ends the program with one line where it cannot be loaded."""
    try:
        import open3d
    except ModuleNotFoundError as error:
        sys.exit(f"{error}: install it with `pip install -r requirements.txt`")
    except (ImportError, OSError) as error:
        sys.exit(f"open3d cannot be loaded ({error}): apt-get install {PACKAGES}")
    return open3d


if __name__ == "__main__":
    print(f"open3d {import_open3d().__version__} loads")
