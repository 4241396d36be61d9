"""Which processors this process may run on. Libraries do not all obey the variables that name
their threads: Open3D and KISS-Matcher take every processor they may run on."""

import os
import platform
from pathlib import Path


def limit(count):
    """Holds the process to the first `count` of its processors; before libraries are loaded."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:count])


def hold_to(processors):
    """Holds a process of a pool to one of its own, from a queue of their numbers."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {processors.get()})


def model():
    """The processor's name and its vectors, where Linux tells them."""
    try:
        facts = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    name = next((line.split(": ")[1] for line in facts if line.startswith("model name")), "")
    flags = next((line.split(": ")[1].split() for line in facts if line.startswith("flags")), [])
    return name + "".join(f" {flag}" for flag in ("avx2", "avx512f") if flag in flags)
