"""Numbers of 50 digits, and vectors of them as lists."""

import numpy as np
from mpmath import MPContext

DIGITS = 50

mp = MPContext()
"""A context of its own, so that nobody else's precision changes."""
mp.dps = DIGITS


def exact(value):
    """A float as the binary number it is, text as the decimal number it says."""
    return mp.mpf(value if isinstance(value, str) else float(value))


def rows(table):
    """A table of floats or of decimal text, as lists of exact numbers."""
    return [[exact(value) for value in row] for row in table]


def as_float(values):
    """Nearest f64 of a number, a list or a table."""
    if isinstance(values, list):
        return np.array([as_float(value) for value in values])
    return float(values)


def dot(a, b):
    return mp.fsum(x * y for x, y in zip(a, b))


def minus(a, b):
    return [x - y for x, y in zip(a, b)]


def times(factor, a):
    return [factor * x for x in a]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def norm(a):
    return mp.sqrt(dot(a, a))


def applied(matrix, vector):
    """matrix @ vector, the matrix as a list of rows."""
    return [dot(row, vector) for row in matrix]


def mean(points):
    return [mp.fsum(axis) / len(points) for axis in zip(*points)]
