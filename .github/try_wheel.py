"""Registers two clouds by the installed package and checks the pose: PYTHONPATH=tests/python."""

import platform
from importlib.metadata import version

import cfreg
import numpy as np
from shapes import terrain, turned

source, (target, truth) = terrain(2000, seed=1), turned(terrain(2000))
found = cfreg.register(source, target)
print(f"cfreg {version('cfreg')}, Python {platform.python_version()}, {platform.platform()}")
print(found)
assert found.verdict.decision == "accept", found.verdict
assert np.abs(found.transform - truth).max() < 0.05, found.transform - truth
